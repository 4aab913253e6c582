"""Exceptions of a plant or a law as text: a line for the reason of a run, and the traceback for its log."""

from __future__ import annotations

import os
from traceback import TracebackException, extract_tb
from types import TracebackType
from typing import Optional, Tuple

#: Frames of a traceback that are shown, and characters of its text.
MOST_FRAMES = 20
LONGEST_TEXT = 16_000
LONGEST_MESSAGE = 1000
_OWN = os.path.dirname(os.path.abspath(__file__)) + os.sep


def describe(error: BaseException) -> Tuple[str, str]:
    """Returns an exception as one line with its place, and as text; the text is empty if it was raised by no code."""
    foreign = _foreign(error.__traceback__)
    message = _message(error)
    # A refusal says what is wrong; the kind of any other exception is part of its reason.
    line = message if isinstance(error, ValueError) and message else f"{type(error).__name__}: {message}".rstrip(": ")
    if isinstance(error, SyntaxError):
        return _printable(line), text(error)
    if foreign is None:
        return _printable(message or line), ""
    # The last one that is not of this package: a method may call a session.
    frame = [frame for frame in extract_tb(foreign) if not frame.filename.startswith(_OWN)][-1]
    place = f"{os.path.basename(frame.filename)} line {frame.lineno}, in {frame.name}"
    return _printable(f"{line} ({place})"), text(error)


def text(error: BaseException) -> str:
    """Returns the traceback of an exception without the frames of this package, and of bounded length."""
    shown = TracebackException(type(error), error, _foreign(error.__traceback__), limit=-MOST_FRAMES)
    lines = _printable("".join(shown.format()).rstrip())
    if len(lines) > LONGEST_TEXT:
        half = LONGEST_TEXT // 2
        lines = f"{lines[:half]}\n  ...\n{lines[-half:]}"
    return lines


def _printable(text: str) -> str:
    """Returns a text with escapes in place of characters that would act on a terminal; lines and tabs stay."""
    if text.isprintable():
        return text
    kept = (one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode() for one in text)
    return "".join(kept)


def _message(error: BaseException) -> str:
    try:
        message = str(error)
    except Exception:
        message = "its text cannot be made"
    message = " ".join(message.split())
    return message if len(message) <= LONGEST_MESSAGE else f"{message[:LONGEST_MESSAGE]} ..."


def _foreign(trace: Optional[TracebackType]) -> Optional[TracebackType]:
    """Returns a traceback from its first frame outside this package on."""
    while trace is not None:
        name = trace.tb_frame.f_code.co_filename
        if not name.startswith(_OWN) and name != "<string>" and not name.startswith("<frozen importlib"):
            return trace
        trace = trace.tb_next
    return None
