# SPDX-License-Identifier: Apache-2.0
"""The commands that the documents print: in code blocks, and inline between backquotes."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Iterator, List, Tuple

HEADS = ("make", "rosrun", "roslaunch", "rosservice", "git", "cd", "scp", ".", "python", "export")
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
_INLINE = re.compile(r"`([^`\n]+)`")
_VARIABLE = re.compile(r"[A-Z][A-Z_]*=")


@dataclass(frozen=True)
class Command:
    """One command line as printed, without its comment; ``in_block`` where a reader pastes it
    whole."""

    where: str
    text: str
    in_block: bool

    @property
    def words(self) -> List[str]:
        """As a shell splits it, without variables and sudo before it; brackets around what is
        optional fall away."""
        text = re.sub(r"(?<=\s)\[(-[^\]]*)\]", r"\1", self.text)
        words = shlex.split(text.rstrip(";"))
        while words and (_VARIABLE.match(words[0]) or words[0] == "sudo"):
            words = words[1:]
        if words and Path(words[0]).name == "python" and len(words) > 1:
            words = words[1:]
        return words

    @property
    def head(self) -> str:
        return self.words[0] if self.words else ""


def is_command(words: List[str]) -> bool:
    """Whether this is a command of ours: make, ROS, or a script of tools/ with its arguments."""
    if not words:
        return False
    script = (
        words[0].startswith("tools/")
        and Path(words[0]).suffix in ("", ".py")
        and len(words[0]) > len("tools/")
    )
    return script or (words[0] in HEADS[:4] and len(words) > 1)


def _begins(line: str) -> bool:
    """Whether a block that begins with this line holds commands: one of HEADS, or a script of
    tools/."""
    try:
        head = Command("", re.sub(r"(^|\s)#.*", "", line), True).head
    except ValueError:  # what a program printed
        return False
    return head in HEADS or head.startswith("tools/")


def _of_block(where: str, block: str) -> Iterator[Command]:
    lines = [line for line in block.replace("\\\n", " ").splitlines() if line.strip()]
    if not lines or not _begins(lines[0]):
        return
    for line in lines:
        bare = re.sub(r"(^|\s)#.*", "", line)
        for part in bare.split(" && "):
            if part.strip():
                yield Command(where, part.strip(), True)


def _of_line(where: str, line: str) -> Iterator[Command]:
    """Inline commands of a line; `VAR=value` alone belongs to the make target that stands before
    it."""
    target = ""
    for inline in _INLINE.findall(line):
        for text in (part.strip() for part in inline.split(";")):
            words = text.split()
            if _VARIABLE.match(text) and target and len(words) == 1:
                text = f"{target} {text}"
            try:
                command = Command(where, text, False)
                if not is_command(command.words):
                    continue
            except ValueError:  # prose with an apostrophe
                continue
            target = " ".join(command.words[:2]) if command.head == "make" else target
            yield command


def commands(root: Path) -> List[Command]:
    """Of README.md, CONTRIBUTING.md and docs/, each once."""
    found = {}
    for path in [
        root / "README.md",
        root / "CONTRIBUTING.md",
        *sorted((root / "docs").rglob("*.md")),
    ]:
        name, text = str(path.relative_to(root)), path.read_text()
        for _, block in _BLOCK.findall(text):
            for command in _of_block(name, block):
                found.setdefault((command.text, True), command)
        for line in _BLOCK.sub("", text).splitlines():
            for command in _of_line(name, line):
                found.setdefault((command.text, False), command)
    return list(found.values())


def split_arguments(words: List[str]) -> Tuple[List[str], List[str]]:
    """(what argparse reads, names of the ROS arguments ``name:=value``)."""
    ros = [w for w in words if ":=" in w]
    return [w for w in words if ":=" not in w], [w.split(":=")[0] for w in ros]
