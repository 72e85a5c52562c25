"""Everything that grading a class depends on, and its hash."""

import contextlib
import hashlib
import json
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import dualnav_lite
from dualnav_lite.chunks import code_sha256
from dualnav_lite.config import UnusableInput
from dualnav_lite.exercises import stub
from grading.folders import own_prefix
from grading.job import Limits
from grading.lesson import Setting
from grading.masking import masked_copy, tainted_kernels
from grading.rebuild import Master, Unreadable, read_master
from grading.rubric import Rubric
from grading.secret import Secret
from grading.shown import kernel_cache

PACKAGE = Path(dualnav_lite.__file__).resolve().parent
NOTEBOOKS = PACKAGE.parent / "notebooks"
ENDINGS = (".onnx", ".pth")  # of weights; the first that is there counts


@dataclass
class Room:
    """Everything that grading a class depends on."""

    rubric: Rubric
    secret: Secret
    tier: str
    limits: Limits
    packages: Path
    kernels: Path | None
    masters: dict[str, Master]

    def fingerprint(self) -> str:
        """Hash of all that a result depends on besides the submission."""
        here = Path(__file__).parent
        code = [path.read_bytes() for path in sorted(here.rglob("*.py"))]
        parts = [
            *code,
            code_sha256().encode(),
            self.rubric.model_dump_json().encode(),
            self.secret.fingerprint.encode(),
            self.tier.encode(),
            json.dumps(asdict(self.limits)).encode(),
            repr(self.masters).encode(),
        ]
        return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()

    def wanted(self) -> frozenset[str]:
        """Names of the files that a submission may hold."""
        notebooks = {f"{name}.ipynb" for name in self.rubric.lessons}
        policy = self.rubric.policy
        return frozenset(notebooks | ({f"{policy.weights}{ending}" for ending in ENDINGS} if policy else set()))

    def setting(self, lesson: str = "") -> Setting:
        """What a lesson, or with no lesson the policy, is graded with."""
        master, rules = self.masters.get(lesson), self.rubric.lessons.get(lesson)
        return Setting(master, rules, self.packages, self.kernels, self.secret, self.tier, self.limits)

    def shipped_weights(self) -> frozenset[str]:
        """Hashes of the weights that the kit itself ships; who hands these in has trained nothing."""
        models = PACKAGE.parent / "models"
        return frozenset(
            hashlib.sha256(path.read_bytes()).hexdigest() for path in models.glob("*") if path.suffix in ENDINGS
        )


@contextlib.contextmanager
def prepared(rubric: Rubric, secret: Secret, tier: str, limits: Limits, notebooks: Path = NOTEBOOKS):
    """A `Room` with its masked copy of the library, which is taken away afterwards.

    Raises:
        UnusableInput: a lesson's notebook is missing or lacks an exercise of the rubric.
    """
    masters = {}
    for name, lesson in rubric.lessons.items():
        try:
            masters[name] = read_master(notebooks / f"{name}.ipynb", stub)
        except (OSError, Unreadable):
            raise UnusableInput(
                f"the rubric names lesson '{name}', but notebooks/{name}.ipynb cannot be read"
            ) from None
        missing = sorted(set(lesson.cells()) - set(masters[name].solutions))
        if missing:
            raise UnusableInput(f"the rubric names exercise '{missing[0]}', which {name}.ipynb does not hold")
    folder = Path(tempfile.mkdtemp(prefix=own_prefix()))
    try:
        packages = masked_copy(PACKAGE, rubric.mask(), folder / "packages")
        kernels = _kernels_to_show(kernel_cache(PACKAGE), tainted_kernels(PACKAGE, rubric.mask()), folder / "kernels")
        yield Room(rubric, secret, tier, limits, packages, kernels, masters)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _kernels_to_show(cache: Path | None, tainted: set[str], out: Path) -> Path | None:
    """Compiled kernels without those that hold something masked; they would answer what is asked."""
    if cache is None:
        return None
    out.mkdir()
    for path in cache.glob("*.nb[ic]"):
        if path.name.partition(".")[0] not in tainted:
            shutil.copy2(path, out / path.name)
    return out
