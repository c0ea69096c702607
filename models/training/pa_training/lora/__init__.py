"""Trains a LoRA adapter on the very weights that will run, and writes it for llama.cpp."""
