"""What is measured: rows of episodes, tables made for the claims, speed, and the figures of all of it."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from dualnav_lite.commands import (
    CORES,
    TEST_SEED,
    Cluster,
    Episodes,
    Jobs,
    Scenarios,
    Seeds,
    Shard,
    app,
    config_of,
    scenarios_of,
    words,
)


@app.command()
def evaluate(
    arms: Annotated[str, typer.Argument(help="ppo, ppo_filter, planners, .onnx files, by commas.")],
    scenarios: Scenarios = "",
    episodes: Episodes = 100,
    seed_base: Seeds = TEST_SEED,
    jobs: Jobs = CORES,
    shard: Shard = "1/1",
    cluster: Cluster = "",
    config: Annotated[Path | None, typer.Option(help="config.yaml to use; the defaults if not given.")] = None,
    preference: Annotated[float | None, typer.Option(help="0 all safety, 1 all thrift.")] = None,
    out: Annotated[Path, typer.Option(help="Results folder.")] = Path("results"),
) -> int:
    """Policies and planners over scenarios and seeds, to episodes.csv and survival.csv; stopped, it goes on."""
    from dualnav_lite.config import write_atomic
    from dualnav_lite.evaluate import evaluate as run
    from dualnav_lite.report import survival_lines
    from dualnav_lite.stress import error_rows, shard_of
    from dualnav_lite.survival import survival

    settings = config_of(config)
    rows = run(
        words(arms),
        scenarios_of(scenarios, settings),
        range(seed_base, seed_base + episodes),
        out,
        config=settings,
        preference=preference,
        jobs=jobs,
        shard=shard_of(shard),
        cluster=cluster,
    )
    made = json.loads((out / "run.json").read_text(encoding="utf-8"))
    table = survival(rows, policy_sha256=made["policy_sha256"], config_sha256=made["config_sha256"])
    write_atomic(out / "survival.csv", table.to_csv(index=False, lineterminator="\n"))
    empty = f"shard {shard} holds no episodes: there are fewer chunks than shards"
    print("\n".join(survival_lines(table)) if len(rows) else empty)
    failed = error_rows(rows)
    for what, reason in failed:
        print(f"FAILED {what}: {reason}", file=sys.stderr)
    return 1 if failed else 0


@app.command()
def measure(
    name: Annotated[str, typer.Argument(help="A name of dualnav_lite/measures/tables.py; a wrong one lists them.")],
    arms: Annotated[str, typer.Option(help="Arms, separated by commas; the measurement's own if empty.")] = "",
    scenarios: Annotated[str, typer.Option(help="Scenario ids, separated by commas; its own if empty.")] = "",
    episodes: Annotated[int, typer.Option(min=0, help="Seeds of each; its own number if 0.")] = 0,
    seed_base: Seeds = TEST_SEED,
    jobs: Jobs = CORES,
    out: Annotated[Path, typer.Option(help="Folder of the CSVs.")] = Path("results"),
) -> int:
    """Tables of their own: fronts, battery band, latency, endpoint error, three hours, ablations, failures."""
    from dualnav_lite.measures.tables import MOST_ROWS, Options
    from dualnav_lite.measures.tables import run as run_measure

    options = Options(
        out, words(arms) if arms else (), words(scenarios) if scenarios else (), episodes, seed_base, jobs
    )
    for table, content in run_measure(name, options).items():
        if len(content) <= MOST_ROWS:
            print(content.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
        print(f"{out / table}.csv: {len(content)} rows\n")
    return 0


@app.command()
def publish(
    work: Annotated[Path, typer.Option(help="Folder for the chunks; the same command goes on from them.")],
    to: Annotated[Path | None, typer.Option(help="Where the rows go; stress_tests/reference if not given.")] = None,
    share: Annotated[float, typer.Option(min=0, max=1, help="Of the numbers of seeds, to try it.")] = 1.0,
    only: Annotated[str, typer.Option(help="Blocks: main, rest, long_ppo, long_filter, long_rest.")] = "",
    jobs: Jobs = CORES,
) -> int:
    """The published rows of every arm on the test seeds, again: hours, said before it starts. Stopped, it goes on."""
    from dualnav_lite.judge import REFERENCE
    from dualnav_lite.publish import publish as run_publish

    command = " ".join(["python -m dualnav_lite", *sys.argv[1:]])
    rows = run_publish(work, to or REFERENCE, share, jobs, words(only) if only else (), command)
    print(f"{len(rows)} rows in {to or REFERENCE}")
    return 0


@app.command()
def claims(
    results: Annotated[Path | None, typer.Option(help="Tables that come before the published ones.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of CLAIMS.md and STUDIES.md; docs if not given.")] = None,
) -> int:
    """The article's claims beside what was measured, claims.csv and CLAIMS.md; what studies found, STUDIES.md."""
    from dualnav_lite.claims import all_claims, claims_page, claims_table, reference_tables
    from dualnav_lite.config import ROOT, write_atomic
    from dualnav_lite.judge import REFERENCE, csv_text
    from dualnav_lite.study_tables import read_studies, studies_page

    known = all_claims()
    table = claims_table(known, reference_tables(results))
    write_atomic((out or REFERENCE) / "claims.csv", csv_text(table))
    pages = out or ROOT / "docs"
    write_atomic(pages / "CLAIMS.md", claims_page(known, table))
    write_atomic(pages / "STUDIES.md", studies_page(read_studies()))
    columns = ["claim", "article_value", "verdict", "our_value", "low", "high", "n"]
    print(table[columns].to_string(index=False, float_format=lambda value: f"{value:.3g}", na_rep=""))
    return 0


@app.command()
def bench(
    seconds: Annotated[float, typer.Option(min=0.05, help="Time for each measurement.")] = 2.0,
    peers: Annotated[bool, typer.Option("--peers/--no-peers", help="Measure other simulators in the same run.")] = True,
    out: Annotated[Path, typer.Option(help="Folder of bench.csv.")] = Path("results"),
) -> int:
    """Speed of everything that is waited for; exit 1 where a first target is missed."""
    from dualnav_lite.bench import run

    rows = run(out, seconds=seconds, with_peers=peers)
    return 1 if any(row.verdict == "below" for row in rows) else 0


@app.command()
def figures(
    names: Annotated[str, typer.Argument(help="Figures, separated by commas; all if not given.")] = "",
    lang: Annotated[str, typer.Option(help="en or zh.")] = "en",
    formats: Annotated[str, typer.Option(help="Of png, svg and pdf, separated by commas.")] = "png",
    results: Annotated[Path | None, typer.Option(help="Draw the figures of this results folder instead.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder; docs/figures, or figures/ of the results, if not given.")
    ] = None,
) -> int:
    """Draw the figures of the documentation, or those of a results folder."""
    if results:
        from dualnav_lite.figures.results import make_result_figures

        drawn = make_result_figures(results, lang, tuple(words(formats)), words(names) if names else None, out=out)
        print("\n".join(str(path) for path in drawn))
        return 0
    from dualnav_lite.config import ROOT
    from dualnav_lite.figures import make_figures

    folder = out or ROOT / "docs" / "figures"
    made = make_figures(folder, lang, words(names) if names else None, formats=tuple(words(formats)))
    print("\n".join(str(path) for path in made))
    return 0


@app.command()
def beyond(
    name: Annotated[str, typer.Argument(help="One of the tables in dualnav_lite/beyond/tables.py, as crowdnav.")],
    quick: Annotated[bool, typer.Option("--quick", help="A few episodes, to see that it works.")] = False,
    out: Annotated[Path, typer.Option(help="Folder of the table's CSV.")] = Path("results"),
) -> int:
    """Measure a table from beyond the kit's own world again: CrowdNav's protocol and others."""
    from dualnav_lite.beyond.tables import run as measure

    print(measure(name, out, quick).to_string(index=False, float_format=lambda value: f"{value:.3f}"))
    return 0
