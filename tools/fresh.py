# SPDX-License-Identifier: Apache-2.0
"""Proves that README's commands need nothing but a bare Debian 12: makes one in a folder, clones this checkout into
it and runs `make demo` and `make test` there, once as root and once as a user with sudo.

    make fresh                                       # all four; two hours on two cores
    make fresh ARGS="--as user --commands demo"      # part of it; --write puts the rows into docs/lab/results.md

It needs root, debootstrap, mounts, and apt's sources of this machine. All mounts stand in a namespace of their own,
which ends with this program however it ends; the folder is removed then, unless --keep is given. What tells this
machine the way to its package sources (apt's Acquire options, pip's configuration, proxy variables, name servers) goes
into the new machine; nothing else does.

Exit status 0 where all commands succeeded, 1 where one failed, 2 for wrong arguments, 3 where this machine cannot make
a bare Debian, with the reason.
"""

import argparse
import datetime
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Iterable, List, Optional, Sequence, Tuple

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "lab" / "results.md"
SUITE, COMPONENT = "bookworm", "main"
INCLUDED = "ca-certificates,git,make,sudo"  # what a user has who reads `git clone` and `make demo`
PRIVATE = "FCSV_FRESH_NAMESPACE"  # set in the process that runs in namespaces of its own
USER = "pilot"
HOMES = {"root": "/root", "user": f"/home/{USER}"}
# each of the two is once the first command on a bare machine
ORDERS = {"root": ("demo", "test"), "user": ("test", "demo")}
PROXIES = ("http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY")
FAILED, WRONG, NOT_HERE = 1, 2, 3
HEADER = (
    "| bare Debian 12, as | command | result | minutes | disk afterwards | Debian packages | date |"
)


class NotHere(Exception):
    """This machine cannot make a bare Debian; the message says why and what to do."""


@dataclass(frozen=True)
class Run:
    """One command on a machine: what came of it, how long it took, and what the machine holds afterwards."""

    who: str
    command: str
    status: int
    took_s: float
    disk_bytes: int
    packages: int
    date: str

    def row(self) -> str:
        """The run's row of the table under ``HEADER``.

        >>> Run("root", "make demo", 0, 300.0, 4_200_000_000, 900, "2026-11-27").row()
        '| root | `make demo` | succeeded | 5.0 | 4.2 GB | 900 | 2026-11-27 |'
        """
        result = "succeeded" if self.status == 0 else f"failed, status {self.status}"
        minutes, gigabytes = self.took_s / 60.0, self.disk_bytes / 1e9
        return (
            f"| {self.who} | `{self.command}` | {result} | {minutes:.1f} | {gigabytes:.1f} GB"
            f" | {self.packages} | {self.date} |"
        )


def mirror_of(targets: str) -> str:
    """The address of the first archive of Debian 12 in ``apt-get indextargets`` of "URI RELEASE CODENAME COMPONENT".

    Raises NotHere where there is none.
    """
    for line in targets.splitlines():
        fields = line.split()
        if len(fields) == 4 and SUITE in fields[1:3] and fields[3] == COMPONENT:
            return fields[0]
    raise NotHere(
        "apt's sources on this machine name no archive of Debian 12; name one with --mirror URL"
    )


def with_rows(page: str, runs: Sequence[Run]) -> str:
    """The page with a row for each run, in place of the row of the same user and command where there is one.

    Raises ValueError where the page has no table under ``HEADER``.
    """
    lines = page.splitlines()
    if HEADER not in lines:
        raise ValueError(f"no table '{HEADER}'")
    first = last = lines.index(HEADER) + 2
    while last < len(lines) and lines[last].startswith("|"):
        last += 1
    rows = {tuple(row.split("|")[1:3]): row for row in lines[first:last]}
    rows.update({tuple(run.row().split("|")[1:3]): run.row() for run in runs})
    return "\n".join([*lines[:first], *rows.values(), *lines[last:]]) + "\n"


def installed(root: Path) -> List[str]:
    """The names of the Debian packages that are installed below ``root``, from dpkg's own file."""
    text = (root / "var/lib/dpkg/status").read_text(errors="replace")
    stanzas = [
        dict(re.findall(r"^(Package|Status): (.*)$", s, re.MULTILINE)) for s in text.split("\n\n")
    ]
    return sorted(s["Package"] for s in stanzas if s.get("Status", "").endswith(" installed"))


def disk_bytes(root: Path) -> int:
    """Disk that the files below ``root`` take; what is mounted there does not count."""
    done = subprocess.run(["du", "-sxB1", str(root)], capture_output=True, text=True)
    return int(done.stdout.split()[0])


def check_machine() -> None:
    """Raises NotHere, with the reason, where this machine cannot make a bare Debian."""
    if sys.platform != "linux" or os.geteuid() != 0:
        raise NotHere(
            "a bare Debian in a folder needs root (mounts and chroot): run it as root, or with sudo"
        )
    for tool in ("debootstrap", "unshare", "apt-get", "git"):
        if shutil.which(tool) is None:
            raise NotHere(
                f"{tool} is not installed: apt-get install {'util-linux' if tool == 'unshare' else tool}"
            )
    done = subprocess.run(
        ["unshare", "--mount", "--pid", "--fork", "mount", "-t", "tmpfs", "none", "/mnt"],
        capture_output=True,
        text=True,
    )
    if done.returncode != 0:
        raise NotHere(
            f"this machine permits no mounts ({done.stderr.strip()}): run it on one that does"
        )


def mirror_of_this_machine() -> str:
    form = "$(REPO_URI) $(RELEASE) $(CODENAME) $(COMPONENT)"
    command = ["apt-get", "indextargets", "--format", form, "Identifier: Packages"]
    return mirror_of(subprocess.run(command, capture_output=True, text=True).stdout)


def in_namespaces(arguments: Sequence[str]) -> int:
    """Run this program again where its mounts and processes end with it; passes on Ctrl-C and its exit status."""
    command = ["unshare", "--mount", "--propagation", "private", "--pid", "--fork", "--kill-child"]
    child = subprocess.Popen(
        [*command, sys.executable, __file__, *arguments], env={**os.environ, PRIVATE: "1"}
    )

    def end(*_):
        child.terminate()  # unshare dies, and --kill-child kills all that runs in the new machine

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, end)
    status = child.wait()
    return status if status >= 0 else 128 - status


def bootstrap(base: Path, mirror: str) -> None:
    """Makes a bare Debian 12 below ``base``. Raises NotHere with debootstrap's last lines where it fails."""
    command = [
        "debootstrap",
        "--variant=minbase",
        f"--include={INCLUDED}",
        SUITE,
        str(base),
        mirror,
    ]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        raise NotHere("debootstrap failed:\n" + "\n".join(done.stdout.splitlines()[-5:]))


def way_to_packages(base: Path) -> None:
    """Tell the machine below ``base`` how this one reaches package sources, and nothing else of it."""
    acquire = subprocess.run(
        ["apt-config", "dump", "Acquire"], capture_output=True, text=True
    ).stdout
    of_network = [
        line for line in acquire.splitlines() if re.match(r"Acquire::(https?|Retries)\b", line)
    ]
    (base / "etc/apt/apt.conf.d/00acquire").write_text("\n".join(of_network) + "\n")
    for name in ("resolv.conf", "hosts"):
        shutil.copyfile(f"/etc/{name}", base / "etc" / name)
    for path in (
        Path("/etc/pip.conf"),
        Path.home() / ".config/pip/pip.conf",
    ):  # the user's overrules
        if path.is_file():
            shutil.copyfile(path, base / "etc/pip.conf")
    certificates = Path("/usr/local/share/ca-certificates")
    if certificates.is_dir():
        shutil.copytree(certificates, base / "usr/local/share/ca-certificates", dirs_exist_ok=True)
        subprocess.run(
            ["chroot", str(base), "update-ca-certificates"], check=True, capture_output=True
        )
    told = {name: os.environ[name] for name in PROXIES if name in os.environ}
    (base / "etc/environment").write_text(
        "".join(f'{name}="{value}"\n' for name, value in told.items())
    )


def bundle(checkout: Path, target: Path) -> None:
    """The committed state of this checkout as one file that `git clone` reads."""
    branch = subprocess.run(
        ["git", "-C", str(checkout), "branch", "--show-current"], capture_output=True, text=True
    )
    refs = ["HEAD", *branch.stdout.split()]
    subprocess.run(
        ["git", "-C", str(checkout), "bundle", "create", "-q", str(target), *refs], check=True
    )
    target.chmod(0o644)


def mount_devices(root: Path) -> None:
    """Processes, devices and memory file systems of a machine, in this process's own namespace of mounts."""
    for kind, place in (("proc", "proc"), ("sysfs", "sys"), ("tmpfs", "run")):
        subprocess.run(["mount", "-t", kind, kind, str(root / place)], check=True)
    subprocess.run(["mount", "--rbind", "/dev", str(root / "dev")], check=True)
    subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "mode=1777", "tmpfs", str(root / "tmp")], check=True
    )
    # as a machine that boots does; without it a user's Xvfb has abstract sockets only, which all
    # machines of this network share
    sockets = root / "tmp" / ".X11-unix"
    sockets.mkdir()
    sockets.chmod(0o1777)


def as_login(root: Path, who: str, line: str) -> int:
    """The exit status of a shell line that ``who`` says after logging in on the machine below ``root``."""
    name = USER if who == "user" else "root"
    return subprocess.run(["chroot", str(root), "su", "-", name, "-c", line]).returncode


def prepare(base: Path, root: Path, who: str) -> None:
    """A machine below ``root``: the bare one below ``base``, with a user who may use sudo where ``who`` is user."""
    subprocess.run(["cp", "-a", "--reflink=auto", str(base), str(root)], check=True)
    mount_devices(root)
    if who == "user":
        add = ["useradd", "--create-home", "--shell", "/bin/bash", USER]
        subprocess.run(["chroot", str(root), *add], check=True)
        (root / "etc/sudoers.d/pilot").write_text(f"{USER} ALL=(ALL) NOPASSWD: ALL\n")
        (root / "etc/sudoers.d/pilot").chmod(0o440)
    if as_login(root, who, "git clone -q /checkout.bundle fcsv") != 0:
        raise NotHere(f"the checkout could not be cloned on the new machine as {who}")


def run_on(root: Path, who: str, command: str) -> Run:
    """Run ``make COMMAND`` and measure it; its output goes to this program's."""
    print(f"== bare Debian 12, as {who}: make {command}", flush=True)
    began_s = time.monotonic()
    status = as_login(root, who, f"cd fcsv && make {command}")
    took_s = time.monotonic() - began_s
    today = datetime.date.today().isoformat()
    return Run(
        who, f"make {command}", status, took_s, disk_bytes(root), len(installed(root)), today
    )


def all_runs(asked, folder: Path) -> Tuple[List[Run], List[str]]:
    """(runs, names of the packages that they installed), each user on a copy of one bare machine."""
    base = folder / "bare"
    began_s = time.monotonic()
    bootstrap(base, asked.mirror)
    way_to_packages(base)
    bundle(ROOT, base / "checkout.bundle")
    bare = installed(base)
    print(
        f"bare Debian 12: {time.monotonic() - began_s:.0f} s, {disk_bytes(base) / 1e6:.0f} MB, "
        f"{len(bare)} packages",
        flush=True,
    )
    runs, new = [], set()
    for who in asked.who:
        root = folder / who
        prepare(base, root, who)
        runs += [run_on(root, who, command) for command in ORDERS[who] if command in asked.commands]
        new |= set(installed(root)) - set(bare)
    return runs, sorted(new)


def listed(allowed: Iterable[str]):
    """An argparse type: names from ``allowed``, with commas between them."""
    allowed = tuple(allowed)

    def parse(text: str) -> Tuple[str, ...]:
        names = tuple(text.split(","))
        wrong = [name for name in names if name not in allowed]
        if wrong:
            raise argparse.ArgumentTypeError(f"'{wrong[0]}' is not one of {', '.join(allowed)}")
        return names

    return parse


def parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        prog="fresh", description="README's commands on a bare Debian 12 in a folder."
    )
    p.add_argument(
        "--as", dest="who", type=listed(ORDERS), default=tuple(ORDERS), help="root,user (both)"
    )
    p.add_argument(
        "--commands",
        type=listed(("demo", "test")),
        default=("demo", "test"),
        help="demo,test (both)",
    )
    p.add_argument("--folder", type=Path, help="where to make it: 8 GB a user (a temporary folder)")
    p.add_argument("--mirror", help="address of a Debian archive (the one in apt's sources)")
    p.add_argument("--keep", action="store_true", help="leave the folder there")
    p.add_argument("--write", action="store_true", help="write the rows into docs/lab/results.md")
    return p


def report(runs: Sequence[Run], new: Sequence[str], write: bool) -> int:
    """Print what was measured, and write it; the exit status."""
    print(f"installed from Debian's packages ({len(new)}): {' '.join(new)}")
    print(HEADER, re.sub(r"[^|]+", "---", HEADER), *(run.row() for run in runs), sep="\n")
    if write:
        PAGE.write_text(with_rows(PAGE.read_text(), runs))
        print(f"rows: {PAGE.relative_to(ROOT)}")
    return FAILED if any(run.status for run in runs) else 0


def remove(folder: Path) -> None:
    """Remove the folder, in which nothing is mounted any more: the namespace ended with its last process, which may
    still be dying."""
    for _ in range(50):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            return
        time.sleep(0.1)
    shutil.rmtree(folder)


def main(arguments: Sequence[str], environ: Optional[dict] = None) -> int:
    environ = os.environ if environ is None else environ
    asked = parser().parse_args(arguments)
    try:
        if PRIVATE in environ:  # the folder was made, and is removed, by the process outside
            return report(*all_runs(asked, asked.folder), asked.write)
        check_machine()
        mirror = asked.mirror or mirror_of_this_machine()
    except NotHere as why:
        print(f"fresh: cannot be done here: {why}", file=sys.stderr)
        return NOT_HERE
    folder = Path(tempfile.mkdtemp(prefix="fcsv-fresh-", dir=asked.folder))
    folder.chmod(0o755)  # the user of the new machine walks through it
    try:
        return in_namespaces([*arguments, "--folder", str(folder), "--mirror", mirror])
    finally:
        if asked.keep:
            print(f"fresh: kept: {folder}")
        else:
            remove(folder)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
