"""Motion models, the one pass of statistics, fits and residuals."""
