"""Mount namespaces, made by bubblewrap, in which a run's commands find its folders."""

import ctypes
import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

BUBBLEWRAP: Final = "bwrap"


@dataclass(frozen=True)
class MountNamespace:
    """A mount namespace, and the user namespace it belongs to where that is not this process' own.

    Attributes:
        descriptors: Open files of both, in the order in which a process joins them; the namespaces last as long.
    """

    descriptors: tuple[int, ...]

    @classmethod
    def of(cls, mounts: Mapping[str, Path]) -> "MountNamespace":
        """Make a namespace with the machine's folders and those of `mounts`, each at its path below `/`.

        Its root folder is read-only, so that files written beside the folders are not lost silently.

        Raises:
            OSError: bubblewrap is missing, or may not make namespaces here.
        """
        options = []
        for entry in os.scandir("/"):
            if entry.is_symlink():
                options += ["--symlink", os.readlink(entry.path), entry.path]
            elif entry.path not in mounts:
                options += ["--dev-bind", entry.path, entry.path]
        for path, folder in mounts.items():
            options += ["--dev-bind", str(folder), path]
        try:
            return cls._made(options)
        except OSError:  # a root user who may not mount; bubblewrap does this by itself for others
            return cls._made([*options, "--unshare-user"])

    @classmethod
    def _made(cls, options: Sequence[str]) -> "MountNamespace":
        command = [BUBBLEWRAP, *options, "--remount-ro", "/", "sh", "-c", "echo $$; read _"]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as holder:
            assert holder.stdout is not None and holder.stderr is not None
            pid = holder.stdout.readline().strip()
            if not pid:
                raise OSError(holder.stderr.read().strip())
            users = Path("/proc", pid, "ns", "user")
            own = [] if users.samefile("/proc/self/ns/user") else [users]
            return cls(tuple(os.open(each, os.O_RDONLY) for each in [*own, users.with_name("mnt")]))

    def join(self, folder: Path) -> None:
        """Move this process, which has one thread, into the namespace and to `folder`."""
        setns = ctypes.CDLL(None, use_errno=True).setns  # `os.setns` from Python 3.12 on
        for descriptor in self.descriptors:
            if setns(descriptor, 0) != 0:
                raise OSError(ctypes.get_errno(), "setns")
        os.chdir(folder)

    def close(self) -> None:
        """Give it up; processes that joined it keep it."""
        for descriptor in self.descriptors:
            os.close(descriptor)


@functools.lru_cache(maxsize=1)
def can_mount() -> bool:
    """True if bubblewrap is installed and this user may make namespaces with it."""
    if sys.platform != "linux" or shutil.which(BUBBLEWRAP) is None:
        return False
    with tempfile.TemporaryDirectory(prefix="vastflow-mounts-") as folder:
        Path(folder, "there").touch()
        try:
            namespace = MountNamespace.of({"/out": Path(folder)})
        except OSError:
            return False
        try:
            join = functools.partial(namespace.join, Path(folder))
            return subprocess.run(["test", "-e", "/out/there"], check=False, preexec_fn=join).returncode == 0
        except (OSError, subprocess.SubprocessError):
            return False
        finally:
            namespace.close()
