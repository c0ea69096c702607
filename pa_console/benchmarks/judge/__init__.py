"""How good a judge's verdicts are on the plans of an evaluation."""
