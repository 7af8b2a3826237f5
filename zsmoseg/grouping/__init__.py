"""From residuals to groups: kernels, affinity, evidence, decision, motion state."""
