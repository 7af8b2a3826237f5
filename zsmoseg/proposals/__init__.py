"""Where the objects come from: found without networks (``embedded``), or masks that are ``given``."""
