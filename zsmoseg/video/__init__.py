"""Videos: what users point at, which frames are used, reading them by index, exactly."""
