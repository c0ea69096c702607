"""The trainer of adapters, on transformers, peft and datasets; its files are llama.cpp's."""

import os

# Read by the libraries when they are imported: nothing is looked up, and the bar is our own.
os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ.setdefault("TQDM_DISABLE", "1")
# Read by OpenMP: threads that wait for one whose core is busy elsewhere soon sleep.
os.environ.setdefault("GOMP_SPINCOUNT", "1000")
