"""How good pose networks are: metrics, people whom they have not seen, and the ablation of Table 3.6."""
