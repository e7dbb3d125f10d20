"""The argument parser of all commands: one line for every error, which names what was typed."""

import argparse
import os
import re
import sys
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, NoReturn

from dehyst.daemon.printable import NO_FILE_NAME, brief, one_line
from dehyst.daemon.terminal.number_options import number, whole

FILE_WORDS = re.compile(r"FILE|REC|IN|OUT|PNG|[A-Z]+\.[a-z]+.*")
"""What an option's help calls its value if it is the name of a file; a folder is DIR or FOLDER."""
OUTPUTS = {"output", "picture", "log"}
"""Arguments that name a file to be written. Nothing makes the folder of such a file."""


class Parser(argparse.ArgumentParser):
    """An argument parser that reports errors in one line. Every number is finite, and no name of a
    file ends with a slash. commands: the commands' parsers; typed: the arguments as the user gave
    them; aliases: further options that mean the same, as `identify --rate 1000` and --rate-hz."""

    commands: dict[str, "Parser"]

    def __init__(self, *args: Any, **more: Any) -> None:
        super().__init__(*args, **more)
        # argparse (until Python 3.14) takes a negative number with an exponent for an option
        self._negative_number_matcher = re.compile(r"-\.?\d")
        self.register("type", float, number)
        self.register("type", int, whole)
        self.typed: list[str] = []
        self.aliases: Sequence[tuple[str, ...]] = ()

    def error(self, message: str) -> NoReturn:
        """Print what is wrong and how to get help; exit with 2."""
        said = one_line(self.as_typed(message))
        self.exit(2, f"{self.prog}: {said}; see `{self.prog} --help`\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Report a command's unknown and empty arguments as the command's own error: argparse would
        report the former from the top-level parser and name its help, and accept the latter."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        if empty := _find_empty(args):
            self.error(f"an argument is empty: {empty}; give a name or a value there")
        return found, unknown

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help or an error; argparse would conceal that help cannot be written."""
        if file is sys.stdout:
            file.write(message)
            file.flush()
        else:
            super()._print_message(message, file)

    def as_typed(self, message: str) -> str:
        """Return a message with every option under the name that was typed, if it has several."""
        groups = [tuple(a.option_strings) for a in self._actions if len(a.option_strings) > 1]
        for names in [*groups, *self.aliases]:
            if name := _typed_name(names, self.typed):
                either = "|".join(re.escape(one) for one in ("/".join(names), *names))
                message = re.sub(rf"(?<![\w/-])(?:{either})(?![\w/-])", name, message)
        argument = re.match(r"([a-z]+): ", message)  # of a function that the command calls
        if argument and argument[1] not in self.typed:  # it is not a file of this name
            option = f"--{argument[1]}"
            if option in self._option_string_actions:
                message = f"--{message}"
        return message

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Refuse an invalid name of a file before the command begins."""
        words = action.metavar if isinstance(action.metavar, tuple) else (action.metavar or "",)
        of_file = any(FILE_WORDS.fullmatch(word) for word in words)
        if of_file and (why := _why_no_file(arg_string, action.dest in OUTPUTS)):
            raise argparse.ArgumentError(action, f"{brief(repr(arg_string))} {why}")
        return super()._get_value(action, arg_string)


def _why_no_file(name: str, written: bool) -> str:
    """Return why this cannot be the name of a file; "": it can. The command would
    write another file, or fail after its work is done."""
    if name.endswith("/"):
        return NO_FILE_NAME
    folder = os.path.dirname(name) or "."
    if written and not os.path.exists(folder):
        return f"is in a folder that does not exist: {folder}"
    if written and os.path.isdir(folder) and not os.access(folder, os.W_OK | os.X_OK):
        return f"is in a folder that you may not write to: {folder}"
    return ""


def _typed_name(names: Iterable[str], typed: Sequence[str]) -> str:
    """Return which of an option's names was typed, also shortened or with its value; "": none, or
    several of them."""
    found = set()
    for word in typed:
        head = word.partition("=")[0]
        for name in names:
            short = not name.startswith("--") and word.startswith(name) and word[1:2] != "-"
            long = name.startswith("--") and len(head) > 2 and name.startswith(head)
            if short or (long and (head == name or head not in names)):
                found.add(name)
    return found.pop() if len(found) == 1 else ""


def _find_empty(arguments: Sequence[str]) -> str:
    """Return which argument is empty, as an unset variable of a script makes it; "": none. As a
    path, it would be the working directory."""
    for before, word in pairwise(["", *arguments]):
        option, equals, value = word.partition("=")
        if option.startswith("--") and equals and not value:
            return word
        if not word:
            return f"'' after {before}" if before else "the first one"
    return ""
