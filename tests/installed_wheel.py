"""Build the wheel, install it alone, and use it: the generic names stay out of site-packages."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).parent.parent


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-m", "build", "--wheel", "--outdir", folder, str(ROOT)],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        (wheel,) = Path(folder).glob("*.whl")
        tops = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
        assert {t for t in tops if not t.endswith(".dist-info")} == {"zsmoseg"}, tops
        site = Path(folder) / "site"
        subprocess.run(
            [
                sys.executable,
                "-m",
                "pip",
                "install",
                "--quiet",
                "--no-deps",
                "--target",
                str(site),
                str(wheel),
            ],
            check=True,
        )
        script = (
            "import sys; sys.path.insert(0, sys.argv[1]); import zsmoseg, zsmoseg.workflows.stages.graph as s, zsmoseg.workflows.cli, zsmoseg.workflows.export.registry, zsmoseg.workflows.models.catalogue as m; "
            "assert zsmoseg.__file__.startswith(sys.argv[1]); assert 'raft' in m.entries(); print(len(s.names()), 'stages', len(m.entries()), 'models')"
        )
        subprocess.run([sys.executable, "-I", "-c", script, str(site)], check=True, cwd=folder)
    print("wheel ok")


if __name__ == "__main__":
    main()
