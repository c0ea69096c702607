"""Writes what a GPU run brought back as the adapter file that llama.cpp reads.

`python -m pa_training.gpu.export --model NAME --run FOLDER --out FILE` needs `facts.json`
and `masters-*.npy` of the run, and the base that it was trained on.
"""

import argparse
import hashlib
import json
from pathlib import Path

import numpy as np
import torch

from pa_console.llm.models.cache import hash_file
from pa_training.lora.adapter import BASE, BASE_SHA256, PREFIX, Adapter
from pa_training.lora.config import TrainConfig, find_base
from pa_training.lora.export import write_adapter
from pa_training.lora.shape import open_gguf


def main() -> None:
    """Export as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", required=True, help="the base, a model of the catalogue")
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--stored", choices=("f16", "q8_0"), default="q8_0")
    args = parser.parse_args()
    print(f"{args.out}: SHA-256 {export(args.model, args.run, args.out, args.stored)}")


def export(model: str, run: Path, out: Path, stored: str = "q8_0") -> str:
    """Write the adapter of `run` for base `model` to `out` and return its SHA-256.

    Raises ValueError when the run is not whole or is of another base, or OSError.
    """
    facts = json.loads((run / "facts.json").read_text(encoding="utf-8"))
    config = TrainConfig.model_validate(
        {
            "task": "planner",
            "base": model,
            "data": "corpus",
            "rank": facts["rank"],
            "alpha": facts["alpha"],
            "learning_rate": facts["rate"],
            "final_rate": facts["final"],
            "warmup_steps": facts["warmup"],
            "clip": facts["clip"],
            "pack_tokens": facts["tokens"],
            "max_minutes": facts["minutes"],
            "seed": facts["seed"],
            "device": "cuda",
            "precision": "bfloat16",
            "stored": stored,
        }
    )
    path, _ = find_base(config)
    shape = open_gguf(path)[1]
    adapter = Adapter(shape, config.rank, config.alpha, config.seed, "cpu")
    files = sorted(run.glob("masters-*.npy"), key=lambda file: int(file.stem.split("-")[1]))
    flat = torch.from_numpy(np.concatenate([np.load(file) for file in files]).astype(np.float32))
    if len(flat) != adapter.size:
        raise ValueError(f"{run}: has {len(flat)} weights, an adapter of {model} {adapter.size}")
    parts = torch.split(flat, [master.numel() for master in adapter.masters])
    adapter.masters = [
        part.view(master.shape) for part, master in zip(parts, adapter.masters, strict=True)
    ]
    origin = {
        BASE: model,
        BASE_SHA256: hash_file(path),
        f"{PREFIX}.steps": str(facts["step"]),
        f"{PREFIX}.tokens": str(facts["tokens_learnt"]),
    }
    write_adapter(out, adapter, shape, config, origin)
    return hashlib.sha256(out.read_bytes()).hexdigest()


if __name__ == "__main__":
    main()
