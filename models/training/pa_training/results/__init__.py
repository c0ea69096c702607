"""What training leaves: lineage, model card, missions to evaluate with."""
