"""This machine: what works on it, and compiling the kernels."""

from dualnav_lite.commands import app


@app.command()
def doctor() -> int:
    """What works on this machine: versions, sandbox, fonts, browser, cores, speed."""
    from dualnav_lite.doctor import findings

    problems = 0
    for finding in findings():
        problems += finding.is_problem
        print(f"{'PROBLEM' if finding.is_problem else 'ok':<8}{finding.subject:<14}{finding.text}", flush=True)
    return 1 if problems else 0


@app.command()
def warm() -> int:
    """Compile every kernel now, so that no later command waits for it."""
    from dualnav_lite.warm import warm_kernels

    warm_kernels()
    return 0
