"""From a plan to masks: jobs, executors, what is said meanwhile."""
