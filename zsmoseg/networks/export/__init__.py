"""ONNX graphs and their contract from a checkpoint that the user has; torch is needed here and nowhere else."""
