"""Makes the adapters: generated missions, verified plans, labelled verdicts, LoRA training."""
