"""Studies on the twin as finished numbers: the paper's protocol, beyond it, ablation."""
