"""Result files: written whole, named by all that they depend on, in a folder that one grader holds at a time."""

import contextlib
import fcntl
import hashlib
import json
import os
import tempfile
from pathlib import Path

from dualnav_lite.config import UnusableInput
from grading.intake import Submission


def write_whole(path: Path, content: bytes) -> None:
    """A file that is there whole or not at all, also after a loss of power.

    Raises:
        UnusableInput: the disk is full, or the folder refuses.
    """
    name = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".tmp")
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            os.unlink(name)
        if isinstance(error, OSError):
            raise UnusableInput(f"{path.name}: cannot be written: {error.strerror}") from None
        raise


def to_json(content) -> bytes:
    """A result file's text, the same for the same content; without a `<`, so that nothing shows it as a page."""
    text = json.dumps(content, ensure_ascii=False, indent=1, sort_keys=True)
    return text.replace("<", "\\u003c").encode("utf-8")


def result_path(out: Path, fingerprint: str, submission: Submission) -> Path:
    """Where a submission's result stands; the name tells nobody's name."""
    student = hashlib.sha256(submission.student_id.encode("utf-8")).hexdigest()[:16]
    made_of = f"{fingerprint}\0{submission.sha256}\0{submission.rejected}"
    return out / "results" / f"{student}.{hashlib.sha256(made_of.encode()).hexdigest()[:24]}.json"


def write_result(path: Path, result: dict, times: dict) -> None:
    """A result file, and beside it how long it took."""
    write_whole(path.with_suffix(".times"), to_json(times))
    write_whole(path, to_json(result))


def read_result(path: Path) -> dict | None:
    """A result file; None where there is none."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


@contextlib.contextmanager
def locked(out: Path):
    """The only grader in a folder.

    Raises:
        UnusableInput: another one works there, or the folder refuses.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        file = open(out / ".lock", "w", encoding="utf-8")  # noqa: SIM115 (closed below, where the lock is let go)
    except OSError as error:
        raise UnusableInput(f"{out}: cannot be written: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UnusableInput(f"{out}: another grader works in this folder") from None
        except OSError as error:  # some network disks
            raise UnusableInput(f"{out}: cannot be locked: {error.strerror}; name a folder on this machine") from None
        for leftover in [*out.glob(".*.tmp"), *(out / "results").glob(".*.tmp")]:
            leftover.unlink()
        yield
