"""Make the mistakes of a person, read the messages, and paste their cures.

Run: python -m bench.hostile.mistakes [--page FILE.md] [NAME…]

A mistake is *named* if the first message matches its cause, and *cured* if the option or the line
that the message states makes the same command succeed.
"""

import argparse
import os
import re
import shlex
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

from bench.hostile.made import BASE_CLIP, LAB, MISTAKES, Mistake
from pipelines.cli import app

__all__ = ["Outcome", "message_of", "outcome_of", "page"]


@dataclass(frozen=True)
class Outcome:
    """What came of a mistake.

    Attributes
    ----------
    message : str
        The first message, with its hint.
    named : bool
        Whether it matches the cause.
    cured : bool
        Whether the stated cure works; True for mistakes without one.
    """

    mistake: Mistake
    command: str
    message: str
    named: bool
    cured: bool


def message_of(printed: str, code: int) -> str:
    """The message that a person reads first: the error, or else the first warning."""
    lines = [line.strip() for line in printed.splitlines() if line.strip()]
    first = "vision: " if code else "warning: "
    starts = [k for k, line in enumerate(lines) if line.startswith((first, "Likely cause"))]
    if not starts:
        return lines[-1] if code and lines else ""
    found = lines[starts[0] :] if code else [lines[starts[0]]]
    return " ".join(found)[:900]


def outcome_of(mistake: Mistake) -> Outcome:
    """Make a mistake in a folder of its own, and try the cure."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        before = Path.cwd()
        os.chdir(folder)
        try:
            for name, text in mistake.files.items():
                (folder / name).write_text(text, encoding="utf-8")
            words = [word.format(clip=BASE_CLIP, lab=LAB) for word in mistake.words]
            ran = CliRunner().invoke(app, words)
            message = message_of(ran.stderr, ran.exit_code)
            named = re.search(mistake.cause, message, re.IGNORECASE) is not None
            cured = named
            if mistake.option or mistake.line != ("", "", ""):
                cured = _pasted(mistake, words, message, folder)
        finally:
            os.chdir(before)
    command = shlex.join(["vision", *mistake.words]).replace("'{clip}'", "strike.mkv")
    for place in (str(BASE_CLIP.parent), str(folder)):
        message = message.replace(f"{place}/", "")
    return Outcome(mistake, command.replace("'{lab}'", "lab.toml"), message, named, cured)


def _pasted(mistake: Mistake, words: Sequence[str], message: str, folder: Path) -> bool:
    """Whether the same command with the stated cure succeeds without a contradiction."""
    again = list(words)
    if mistake.option:
        stated = re.search(rf"{mistake.option}[ =]('[^']*'|\"[^\"]*\"|[^\s;]+)", message)
        if stated is None:
            return False
        value = stated[1].strip("'\"").rstrip(".,)")
        if mistake.option in again:
            again[again.index(mistake.option) + 1] = value
        else:
            again += [mistake.option, value]
    else:
        name, old, new = mistake.line
        if new not in message:
            return False
        text = (folder / name).read_text(encoding="utf-8") if name else ""
        if name:
            (folder / name).write_text(text.replace(old, new), encoding="utf-8")
        else:
            again = [word.replace(old, new) for word in again]
    ran = CliRunner().invoke(app, again)
    return ran.exit_code == 0 and "Likely cause" not in ran.output


_SHOWN_CHARACTERS = 260
"""Characters of a message on the page."""


def page(outcomes: Sequence[Outcome]) -> str:
    """The page of the evidence."""
    named, cured = sum(one.named for one in outcomes), sum(one.cured for one in outcomes)
    both = sum(one.named and one.cured for one in outcomes)
    lines = [
        "# Mistakes of a person",
        "",
        "`python -m bench.hostile.mistakes --page docs/evidence/mistakes.md` makes each, compares"
        " the first message with the cause, and pastes the cure. No command: that above.",
        "",
        f"Named: {named} of {len(outcomes)}; cured, or no cure needed: {cured}; both: {both}.",
    ]
    kinds = dict.fromkeys(one.mistake.kind for one in outcomes)
    for kind in kinds:
        lines += ["", f"## {kind}", "", "| mistake | message | named | cure |", "|---|---|---|---|"]
        above = ""
        for one in (one for one in outcomes if one.mistake.kind == kind):
            said = textwrap.shorten(one.message, _SHOWN_CHARACTERS, placeholder=" …")
            cells = (one.mistake.name, said if one.command == above else f"`{one.command}`: {said}")
            above = one.command
            shown = " | ".join(cell.replace("|", "\\|").replace("<", "&lt;") for cell in cells)
            lines.append(f"| {shown} | {_yes(one.named)} | {_yes(one.cured)} |")
    return "\n".join(lines) + "\n"


_yes: Callable[[bool], str] = {True: "yes", False: "no"}.__getitem__


def main() -> None:
    """Make all mistakes, or those named."""
    parser = argparse.ArgumentParser(prog="python -m bench.hostile.mistakes", description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--page", type=Path)
    asked = parser.parse_args()
    outcomes = []
    for mistake in MISTAKES:
        if asked.names and not any(word in mistake.name for word in asked.names):
            continue
        found = outcome_of(mistake)
        outcomes.append(found)
        print(
            f"{'ok' if found.named and found.cured else 'NO'} | {mistake.name} |"
            f" named {found.named}, cured {found.cured} | {found.message[:400]}",
            flush=True,
        )
    print(f"{sum(one.named and one.cured for one in outcomes)} of {len(outcomes)}")
    if asked.page is not None:
        asked.page.write_text(page(outcomes), encoding="utf-8")


if __name__ == "__main__":
    main()
