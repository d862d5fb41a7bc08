"""The script that becomes a command in a mount namespace of its own: `mounting.py FD CTYPE ROOT PATH=FOLDER... -- COMMAND...`.

It mounts each folder at its path, in a root folder that has everything else of the machine's, and executes the command there.
Nothing outside of the command's own namespace changes; neither paths nor mount points have to exist on the machine. The number of
an error is written to FD, which is closed when the command begins. It imports little, so that it starts in some milliseconds.
"""

import ctypes
import os
import signal
import sys

CLONE_NEWNS, CLONE_NEWUSER = 0x00020000, 0x10000000
MS_RDONLY, MS_REMOUNT, MS_BIND, MS_REC, MS_UNBINDABLE, MS_PRIVATE = 1, 32, 0x1000, 0x4000, 1 << 17, 1 << 18
MNT_DETACH = 2
LIBC = ctypes.CDLL(None, use_errno=True)


def call(name: str, *arguments: "bytes | int | ctypes.c_ulong | None") -> None:
    """A function of the C library; OSError where it fails."""
    if getattr(LIBC, name)(*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number), name)


def mount(source: str, target: str, flags: int, kind: bytes | None = None, options: bytes | None = None) -> None:
    """As mount(2)."""
    call("mount", os.fsencode(source), os.fsencode(target), kind, ctypes.c_ulong(flags), options)


def written(path: str, text: str) -> None:
    """Write a file of /proc."""
    with open(path, "w") as file:
        file.write(text)


def unshare() -> None:
    """A mount namespace of its own, in a user namespace of its own where the user may not have one else."""
    user, group = os.geteuid(), os.getegid()
    try:
        call("unshare", CLONE_NEWNS)
    except PermissionError:
        call("unshare", CLONE_NEWNS | CLONE_NEWUSER)
        written("/proc/self/setgroups", "deny")
        written("/proc/self/uid_map", f"{user} {user} 1")
        written("/proc/self/gid_map", f"{group} {group} 1")
    mount("none", "/", MS_REC | MS_PRIVATE)


def enter(mounts: dict[str, str], root: str) -> None:
    """Mount everything below `root` and make that the root folder."""
    here = os.getcwd()
    unshare()
    mount("none", root, 0, b"tmpfs", b"mode=755")
    mount("none", root, MS_UNBINDABLE)  # else it is mounted again with the folder that it is in
    for entry in os.scandir("/"):
        target = os.path.join(root, entry.name)
        if entry.path in mounts:
            continue
        if entry.is_symlink():
            os.symlink(os.readlink(entry.path), target)
            continue
        if entry.is_dir():
            os.mkdir(target)
        else:
            os.close(os.open(target, os.O_CREAT | os.O_WRONLY))
        try:
            mount(entry.path, target, MS_BIND | MS_REC)
        except OSError:  # nothing that this user could see into
            continue
    for path, folder in mounts.items():
        os.mkdir(root + path)
        mount(folder, root + path, MS_BIND | MS_REC)
    mount("none", root, MS_REMOUNT | MS_BIND | MS_RDONLY)  # what is written beside the folders is not lost in silence
    os.chdir(root)
    try:
        call("pivot_root", b".", b".")
        call("umount2", b".", MNT_DETACH)
    except OSError:  # the machine's root folder is its first memory disk, which can't be exchanged
        os.chroot(".")
    os.chdir(here)


def main(arguments: list[str]) -> None:
    """Become the command, or report why not."""
    report, ctype, root, *rest = arguments
    end = rest.index("--")
    command = rest[end + 1 :]
    os.set_inheritable(int(report), False)
    try:
        enter(dict(each.split("=", 1) for each in rest[:end]), root)
        # Python has set this variable where the locale is C, and ignores these signals; the command shall not.
        os.environ.pop("LC_CTYPE", None)
        if ctype:
            os.environ["LC_CTYPE"] = ctype
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
        os.execvp(command[0], command)
    except OSError as error:
        os.write(int(report), str(error.errno).encode())
        os._exit(127)


if __name__ == "__main__":
    main(sys.argv[1:])
