"""By what files that are brought are known: in a key it stands for their path."""

from __future__ import annotations

import hashlib
from pathlib import Path

from zsmoseg.stores.location import Store


def fingerprint(store: Store, path: Path) -> str:
    """Hash of names and content of a file or folder; known again while no file was touched."""
    found = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    stats = [(str(p), s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino) for p in found for s in [p.stat()]]

    def compute() -> str:
        whole = hashlib.sha256()
        for file in found:
            with file.open("rb") as stream:
                whole.update(
                    f"{file.relative_to(path.parent)} {hashlib.file_digest(stream, 'sha256').hexdigest()}\n".encode()
                )
        return whole.hexdigest()[:20]

    return store.fingerprint_of(f"import {stats}", compute)
