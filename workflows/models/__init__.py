"""Models on this machine: what the registry knows, where they lie, how they get there."""
