"""From residuals to groups: the static world, kernels, affinity, clustering, motion state."""
