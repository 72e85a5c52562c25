"""Sets dualnav-lite up and runs it. Needs Python 3.11 to 3.13 and nothing else.

usage: python kit.py COMMAND [options]        python kit.py COMMAND --help

  lab         JupyterLab, opened at notebooks/00_start_here.ipynb; --student: the student version, in course/
  stress      the scenarios through papermill: survival table, executed notebooks, a report
  merge       shards of stress, run on several machines, to the tables of the whole
  test        the test suite; --slow adds the long tests; other options go to pytest
  train       a policy or the predictor from a config in training/; goes on where it was stopped
  evaluate    any planner over scenarios and seeds, to episodes.csv
  card        models/README.md from the weights, the training's log and evaluated rows
  record      drives kept whole in data/: scans, maps, true positions, a log of both objectives
  predictor   the LSTM predictor beside constant velocity, on scenarios that it has not seen
  study       one of training/studies again: variants of a training, several seeds each
  beyond      a table from beyond our own world: crowdnav, ...
  measure     fronts, battery band, latency, three hours, ablations, differential evolution: by name
  claims      the article's claims beside what was measured: docs/CLAIMS.md, docs/STUDIES.md
  publish     the published rows of stress_tests/reference again: hours
  bench       speed, with the peers of requirements-bench.txt in the same run
  figures     all figures
  notebooks   rebuild the notebooks from their sources; --check; --take-back NN
  release     the student version of the kit, in a new folder; --check does the dry run of the grading first
  status      which exercises pass, and whose part is used for each
  submit      a student's own check and pack: the folder that is handed in
  grade       submissions to tables, sandboxed (Linux): docs/INSTRUCTORS.md
  doctor      what works on this machine
  warm        compile the kernels now

The first run makes .venv and installs requirements.txt into it; later runs find both done. A virtual
environment that is active and already holds every pinned version is used as it is; any other is left alone.
"""
# An old Python must be able to read this file, else it cannot say that it is too old: no f-strings, no annotations.
# ruff: noqa: UP031, RUF005

import hashlib
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.abspath(__file__))
KERNELS = os.path.join(ROOT, "dualnav_lite", "kernels")
OLDEST, NEWEST = (3, 11), (3, 13)
SIMULATES = (
    "lab", "stress", "merge", "test", "train", "evaluate", "record", "predictor", "study", "beyond", "measure",
    "publish", "bench", "figures", "grade",
)  # fmt: skip
COMMANDS = SIMULATES + ("claims", "card", "notebooks", "release", "status", "submit", "doctor", "warm")


def say(text):
    """A line about what happens, on stderr at once."""
    sys.stderr.write("kit: " + text + "\n")
    sys.stderr.flush()


def stop(text, code):
    """Say why and end."""
    say(text)
    sys.exit(code)


def check_python():
    """End with one line where this Python is too old or too new."""
    version = tuple(sys.version_info[:3])
    if not OLDEST <= version[:2] <= NEWEST:
        problem = "too old" if version[:2] < OLDEST else "too new (some packages have no wheels for it yet)"
        stop("Python %d.%d.%d is %s; run kit.py with Python 3.11, 3.12 or 3.13" % (version + (problem,)), 2)


def read(path):
    """Text of a file, empty where there is none."""
    if not os.path.exists(path):
        return ""
    with open(path, encoding="utf-8") as file:
        return file.read()


def digest(*paths):
    """One hash of the bytes of some files."""
    return hashlib.sha256("\n".join(read(path) for path in paths).encode("utf-8")).hexdigest()


def run(command, problem, **options):
    """Run a step of the set-up to its end; where it fails, say what and end."""
    if subprocess.call(command, **options) != 0:
        stop(problem + "; the lines above say why, README.md has a part on troubles", 1)


def unmet():
    """Pinned packages that the running environment lacks or has in another version."""
    from importlib import metadata

    def installed(name):
        try:
            return metadata.version(name).split("+")[0]  # "2.13.0+cpu" is the CPU build of 2.13.0
        except metadata.PackageNotFoundError:
            return None

    lines = [line.split("#")[0].strip() for line in read(os.path.join(ROOT, "requirements.txt")).splitlines()]
    pins = [line.split("==") for line in lines if "==" in line]
    return [name for name, version in pins if installed(name) != version]


def own_environment():
    """Python of .venv, which is made and filled where it is not what requirements.txt asks for."""
    folder = os.path.join(ROOT, ".venv")
    python = os.path.join(folder, "Scripts", "python.exe") if os.name == "nt" else os.path.join(folder, "bin", "python")
    stamp = os.path.join(folder, "kit.stamp")
    home = "Python %d.%d in %s\n" % (sys.version_info[0], sys.version_info[1], ROOT)
    wanted = home + digest(os.path.join(ROOT, "requirements.txt"))
    found = read(stamp)
    if found != wanted or not os.path.exists(python):
        # Made by another Python or in a folder that has moved since: its scripts point to where they were.
        stale = ["--clear"] if found and not found.startswith(home) else []
        say("making .venv")
        run([sys.executable, "-m", "venv", folder] + stale, "no virtual environment could be made")
        say("installing requirements.txt, about 2 GB on disk; the first time takes minutes")
        run([python, "-m", "pip", "install", "-r", "requirements.txt"], "pip could not install everything", cwd=ROOT)
        with open(stamp, "w", encoding="utf-8") as file:
            file.write(wanted)
    return python


def is_writable(folder):
    """Whether files can be made in a folder, which is made where it is missing."""
    try:
        os.makedirs(folder, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def settings():
    """Environment variables for the commands: this checkout first, UTF-8, a place for compiled kernels."""
    variables = dict(os.environ, PYTHONUTF8="1")
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, [ROOT, os.environ.get("PYTHONPATH")]))
    if "NUMBA_CACHE_DIR" not in variables and not is_writable(KERNELS):
        variables["NUMBA_CACHE_DIR"] = os.path.join(os.path.expanduser("~"), ".cache", "dualnav-lite", "numba")
    cache = variables.get("NUMBA_CACHE_DIR")
    if cache and not is_writable(cache):
        stop("compiled kernels cannot be kept: set NUMBA_CACHE_DIR to a folder that can be written", 2)
    return variables


def kernel_folder(cache):
    """Where numba keeps what it compiled from this checkout's kernels, in NUMBA_CACHE_DIR or, without one, beside them.

    There the name is numba's: the source folder's and the SHA-1 of its path. Other projects' kernels lie next to it.
    """
    if not cache:
        return os.path.join(KERNELS, "__pycache__")
    return os.path.join(cache, os.path.basename(KERNELS) + "_" + hashlib.sha1(KERNELS.encode("utf-8")).hexdigest())


def remove_kernels(folder):
    """Remove the compiled kernels in a folder; how many could not be."""
    kept = 0
    for name in os.listdir(folder) if os.path.isdir(folder) else []:
        if name.endswith((".nbi", ".nbc")):
            try:
                os.remove(os.path.join(folder, name))
            except OSError:
                kept += 1
    return kept


def warm(python, variables):
    """Compile the kernels where they changed since the last time."""
    cache = variables.get("NUMBA_CACHE_DIR", KERNELS)
    # An environment may serve several checkouts, each with compiled kernels of its own.
    label = "kit.warm." + hashlib.sha256(os.fsencode(KERNELS + "\n" + cache)).hexdigest()[:12]
    stamp = os.path.join(os.path.dirname(os.path.dirname(python)), label)
    sources = sorted(name for name in os.listdir(KERNELS) if name.endswith(".py"))
    wanted = digest(*[os.path.join(KERNELS, source) for source in sources])
    if read(stamp) != wanted:
        say("compiling the kernels, once: about a minute, most of it in the first part")
        # numba looks at a kernel's own file only: one that calls a changed kernel of another file would stay as it was.
        folder = kernel_folder(variables.get("NUMBA_CACHE_DIR"))
        kept = remove_kernels(folder)
        if kept:
            say("%d old kernels cannot be removed and may be out of date: close what uses %s" % (kept, folder))
        run([python, "-m", "dualnav_lite", "warm"], "the kernels could not be compiled", env=variables)
        if not kept and is_writable(os.path.dirname(stamp)):
            with open(stamp, "w", encoding="utf-8") as file:
                file.write(wanted)


def is_students_version():
    """Whether a teacher released this folder: the lessons' sources hold the solutions and stay behind."""
    return not os.path.isdir(os.path.join(ROOT, "notebooks", "src"))


def command_line(python, command, options):
    """Arguments and working folder of a command."""
    if command == "lab":
        lessons = "course" if "--student" in options else "notebooks"
        others = [option for option in options if option != "--student"]
        return [python, "-m", "jupyterlab", lessons + "/00_start_here.ipynb"] + others, ROOT
    if command == "test":
        everything = ["-m", ""] if "--slow" in options else []  # the default, in pyproject.toml, is "not slow"
        return [python, "-m", "pytest"] + everything + [option for option in options if option != "--slow"], ROOT
    if command == "grade":
        return [python, "-m", "grading", "grade"] + options, os.getcwd()
    if command == "release" and "--check" in options:
        others = [option for option in options if option != "--check"]
        return [python, "-m", "grading", "release"] + others, os.getcwd()
    return [python, "-m", "dualnav_lite", command] + options, os.getcwd()


def hand_over(command, folder, variables):
    """Become the command: its output, signals and exit code are then the ones of kit.py."""
    if os.name != "nt":
        os.chdir(folder)
        os.execve(command[0], command, variables)
    child = subprocess.Popen(command, cwd=folder, env=variables)
    while True:
        try:
            return child.wait()
        except KeyboardInterrupt:
            continue  # the child got the same Ctrl-C and has the last word


def main(arguments):
    """Set up what the command needs, then run it."""
    check_python()
    if not arguments or arguments[0] in ("-h", "--help"):
        print(__doc__)
        return 0 if arguments else 2
    command, options = arguments[0], arguments[1:]
    if command not in COMMANDS:
        stop("unknown command '%s'; known: %s" % (command, ", ".join(COMMANDS)), 2)
    is_graders = command == "grade" or (command == "release" and "--check" in options)
    if is_graders and not os.path.isdir(os.path.join(ROOT, "grading")):
        stop("grading stays with the teacher: it is not in the student version", 2)
    if command == "test" and not os.path.isdir(os.path.join(ROOT, "tests")):
        stop("the tests stay with the teacher; what works here: python kit.py doctor", 2)
    if is_students_version():
        options = [option for option in options if option != "--student"]  # its lessons are the student's already
    in_environment = sys.prefix != sys.base_prefix
    python = sys.executable if in_environment and not unmet() else own_environment()
    variables = settings()
    if (command in SIMULATES + ("warm",) or is_graders) and "--help" not in options:
        warm(python, variables)
        if command == "warm":
            say("the kernels are compiled")
            return 0
    if command == "lab" and "--help" in options and not is_students_version():
        say("--student opens the lessons with stubs, in course/; the other options are JupyterLab's:")
    elif command == "lab" and "--student" in options:
        release = [python, "-m", "dualnav_lite", "release", "course", "--lessons-only"]
        run(release, "the student version could not be written", cwd=ROOT, env=variables)
    line, folder = command_line(python, command, options)
    return hand_over(line, folder, variables)


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        stop("interrupted; the same command goes on from here", 130)
