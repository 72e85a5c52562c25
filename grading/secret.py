"""The one secret: a key file, from which all hidden inputs follow."""

import hashlib
import hmac
import os
import secrets
from pathlib import Path

import numpy as np

from dualnav_lite.config import UnusableInput

LEAST_BYTES = 32
GRADING_SEEDS = range(3_000_000_000, 4_000_000_000)  # SPEC 8: above all published and training seeds
HOW_TO = "make one with `python -m grading key FILE`, keep it out of the course's repository, and name it by --key"


class Secret:
    """Hidden seeds of one assignment.

    Args:
        key: bytes of the key file.
        assignment: its name; another one has other seeds.
    """

    def __init__(self, key: bytes, assignment: str):
        self._key, self._assignment = key, assignment
        self.fingerprint = self._digest("fingerprint").hex()[:16]  # tells two keys apart and nothing else

    def _digest(self, purpose: str) -> bytes:
        text = f"{self._assignment}\0{purpose}"
        return hmac.new(self._key, text.encode("utf-8"), hashlib.sha256).digest()

    def generator(self, purpose: str) -> np.random.Generator:
        """Random numbers for a purpose, the same for every submission."""
        return np.random.default_rng(int.from_bytes(self._digest(purpose), "big"))

    def seeds(self, purpose: str, count: int) -> list[int]:
        """Distinct world seeds in the range that nothing else uses; more of them begin with the same ones."""
        found: dict[int, None] = {}
        number = 0
        while len(found) < count:
            drawn = int.from_bytes(self._digest(f"{purpose}\0{number}")[:8], "big")
            found[GRADING_SEEDS.start + drawn % len(GRADING_SEEDS)] = None
            number += 1
        return list(found)


def load_secret(path: Path | None, assignment: str) -> Secret:
    """The secret in a key file.

    Raises:
        UnusableInput: no file was named, it is missing, too short, or others may read it.
    """
    if path is None:
        raise UnusableInput(f"grading needs a key file: {HOW_TO}")
    try:
        key = path.read_bytes()
        mode = path.stat().st_mode
    except OSError as error:
        raise UnusableInput(f"{path}: cannot be read ({error.strerror}); {HOW_TO}") from None
    if len(key) < LEAST_BYTES:
        raise UnusableInput(f"{path}: a key has at least {LEAST_BYTES} bytes, this one {len(key)}; {HOW_TO}")
    if os.name == "posix" and mode & 0o077:
        raise UnusableInput(f"{path}: others may read it; `chmod 600` it first")
    return Secret(key, assignment)


def make_key(path: Path) -> None:
    """Write a new key that only its owner may read.

    Raises:
        UnusableInput: the file is there already, or cannot be written.
    """
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise UnusableInput(f"{path}: cannot be made: {error.strerror}") from None
    with os.fdopen(handle, "wb") as file:
        file.write(secrets.token_hex(LEAST_BYTES).encode("ascii") + b"\n")
