"""The rules that give groups: evidence and linking, clusters of the affinity, all as proposed."""
