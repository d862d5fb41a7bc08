"""Build vastflow's image with a Docker daemon, and compare a campaign of its containers with one of this machine.

A scheduler, two workers, and the campaign run in a container each, as user 1000, with the host's network and a shared folder. All
files of the campaign directory must be equal byte by byte but for the two that say when and how it was computed.

The daemon may be `dockerd --iptables=false --bridge=none`. Where no registry is reachable, `--base` makes the base image that
`deployments/Dockerfile` names with `debootstrap`, as root, from Debian's mirror; its Python is Debian's.

    python tests/proofs/docker_image.py [--base] [--only CONFIGURATION] [--folder FOLDER]
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from killed_outcome import differing, digests

ROOT: Final = Path(__file__).parents[2]
DOCKERFILE: Final = ROOT / "deployments" / "Dockerfile"
IMAGE: Final = "vastflow:proof"
CAMPAIGN: Final = "campaigns/quickstart/quickstart.vast"
PORT: Final = "18786"
BUILD_S: Final = 1800
RUN_S: Final = 900
NAMING: Final = ("metadata.json", "report.html")
"""Files that name the version of Python, which may be another one in the image."""
CERTIFICATES: Final = Path("etc/ssl/certs/ca-certificates.crt")


def called(*command: str, timeout_s: float = RUN_S) -> str:
    """Return the output of a command; raises `CalledProcessError`."""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=timeout_s, check=False)
    if done.returncode:
        print(done.stdout[-4000:], done.stderr[-4000:], sep="\n", file=sys.stderr)
    done.check_returncode()
    return done.stdout


def make_base(name: str, folder: Path) -> None:
    """Make a base image of Debian with Python, and with this machine's certificates."""
    packages = "python3,python3-venv,ca-certificates"
    called("debootstrap", "--variant=minbase", f"--include={packages}", "bookworm", str(folder), timeout_s=BUILD_S)
    (folder / CERTIFICATES).write_bytes((Path("/") / CERTIFICATES).read_bytes())
    with subprocess.Popen(["tar", "-C", str(folder), "-c", "."], stdout=subprocess.PIPE) as packed:
        subprocess.run(["docker", "import", "-", name], stdin=packed.stdout, check=True, stdout=subprocess.DEVNULL)


def started(shared: Path, *command: str) -> str:
    """Start a container of the image that has `shared` at its own path, and return its id."""
    mount = f"{shared}:{shared}"
    return called("docker", "run", "--detach", "--network=host", "--volume", mount, IMAGE, *command).strip()


def in_containers(shared: Path, options: Sequence[str]) -> Path:
    """Run the campaign in containers, and return its directory."""
    address = f"tcp://127.0.0.1:{PORT}"
    worker = (
        "dask",
        "worker",
        address,
        "--nthreads",
        "1",
        "--memory-limit",
        "0",
        "--no-dashboard",
        "--dashboard-address",
        "127.0.0.1:0",
    )
    containers = [
        started(
            shared,
            "dask",
            "scheduler",
            "--host",
            "127.0.0.1",
            "--port",
            PORT,
            "--no-dashboard",
            "--dashboard-address",
            "127.0.0.1:0",
        )
    ]
    try:
        containers += [started(shared, *worker) for _ in range(2)]
        places = ("--results", str(shared / "results"), "--store", str(shared / "store"), "--cluster", address)
        containers.append(started(shared, "vastflow", "run", CAMPAIGN, *options, *places, "--workers", "1"))
        code = called("docker", "wait", containers[-1]).strip()
        print(called("docker", "logs", containers[-1]), end="")
        if code != "0":
            raise SystemExit(f"the campaign's container exited with {code}")
    finally:
        for each in containers:
            called("docker", "rm", "--force", each)
    return next((shared / "results").glob("quickstart-*"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", action="store_true", help="make the base image by debootstrap")
    parser.add_argument("--only", default="clutter-1-1", help="configuration to run")
    parser.add_argument("--folder", type=Path, help="where all is made and kept; else a temporary one")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vastflow-docker-") as temporary:
        folder = (asked.folder or Path(temporary)).resolve()
        shared = folder / f"shared-{uuid.uuid4().hex[:8]}"
        shared.mkdir(parents=True)
        os.chmod(folder, 0o755)
        os.chmod(shared, 0o777)  # the containers' user is not this one
        (base,) = re.findall(r"^FROM (\S+)$", DOCKERFILE.read_text(), re.MULTILINE)
        if asked.base:
            make_base(base, folder / "base")
        build = ("docker", "build", "--network=host", "--file", str(DOCKERFILE), "--tag", IMAGE, ".")
        called(*build, timeout_s=BUILD_S)
        print(called("docker", "image", "inspect", "--format", "{{.Id}} {{.Size}} bytes", IMAGE), end="")
        options = ("--only", asked.only, "--runs", "2")
        of_image = in_containers(shared, options)
        places = ("--results", str(folder / "here"), "--store", str(folder / "store-here"))
        called(sys.executable, "-m", "vastflow.flows.cli", "run", CAMPAIGN, *options, *places)
        here = next((folder / "here").glob("quickstart-*"))
        mine, theirs = (
            {name: each for name, each in digests(of).items() if name not in NAMING} for of in (here, of_image)
        )
        different = differing(mine, theirs)
        print(different or f"{len(mine)} files of the campaign directory are equal")
    if different:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
