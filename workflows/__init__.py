"""The DAG: what runs, in which order, where."""
