"""Studies on the twin, as finished numbers: the paper's protocol, the part beyond it, ablation."""
