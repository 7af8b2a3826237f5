"""Stages of the embedded front end: objects out of superpixels, without networks."""
