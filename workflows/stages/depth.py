"""Stage ``depth``: relative inverse depth of every frame."""
