"""The command ``rpil``. What takes time to import is imported inside the commands: ``rpil --help`` answers at once."""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rpil.cli.commands import Commands, Words, cluster, fit_rpil, in_memory, is_streamed, read
from rpil.cli.terminal import (
    advice,
    as_json,
    counter,
    finding,
    headline,
    show_ambiguity,
    show_audit,
    stages,
    suggestion,
)
from rpil.data.files import check_outputs

if TYPE_CHECKING:
    from rpil.audit.record import Audit


# Also known to the modules that own them, but those take a second to import; a test compares.
FEATURES = ("auto", "raw", "folded", "spline", "poly", "nystroem")
ADVERSARIES = (
    "auto", "constant", "uniform", "marginal", "complement", "normalised-complement", "confusion", "own-policy",
)  # fmt: skip
MINORITY = ("ask", "trust", "distrust")
KINDS = ("corrupted", "random", "flip", "shift", "noisy", "window", "sensor")


_seed = click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Same seed, same result.")
_quiet = click.option("--quiet", "-q", is_flag=True, help="Show results only: no progress, no hints.")
_json = click.option("--json", "json_wanted", is_flag=True, help="Print JSON, and nothing else, on stdout.")
_learning = (
    click.option("--labels", metavar="FILE", help="CSV (id,label) or JSON: what you know of some demonstrations."),
    click.option(
        "--demonstrators",
        metavar="FILE|COLUMN",
        help="Who gave what: CSV (id,demonstrator), JSON, or a column of FILE.",
    ),
    click.option(
        "--features", type=click.Choice(FEATURES), default="auto", show_default=True, help="What the policy sees."
    ),
    click.option(
        "--adversary", type=Words(ADVERSARIES), default="auto", show_default=True, help="What bad demonstrators do."
    ),
    click.option(
        "--minority",
        type=click.Choice(MINORITY),
        default="ask",
        show_default=True,
        help="What to think of a second group that acts alike, and otherwise than the first.",
    ),
    click.option("--resume", is_flag=True, help="Go on where a long run was interrupted."),
    click.option("--stream/--no-stream", default=None, help="Leave data on disk, or read them; by default by size."),
    click.option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster to do the work; Parquet only."),
    _seed,
    _quiet,
)


def _learning_options(command: Callable[..., None]) -> Callable[..., None]:
    for option in reversed(_learning):
        command = option(command)
    return command


@click.group(
    name="rpil",
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="rpil")
@click.pass_context
def main(ctx: click.Context) -> None:
    """Which demonstrations can be trusted, and a policy from those.

    FILE holds demonstrations as .parquet, .csv or .npz: one row per step, with the columns episode_index, action and
    observation.*. A folder of .parquet files, or its address, will do too, and need not fit in memory.
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())


@main.command()
@click.argument("file")
@click.option("--report", metavar="OUT.html", help="Also write a report to look at.")
@click.option("--weights", metavar="OUT.parquet|OUT.csv", help="Also write a weight for every step, to train with.")
@click.option("--suggest", metavar="K", type=click.IntRange(1), help="Also say which K labels would tell most.")
@_json
@_learning_options
@click.pass_context
def audit(
    ctx: click.Context,
    file: str,
    report: str | None,
    weights: str | None,
    suggest: int | None,
    json_wanted: bool,
    quiet: bool,
    stream: bool | None,
    scheduler: str | None,
    **learning: Any,
) -> None:
    """Tell how far each demonstration can be trusted."""
    start = time.perf_counter()
    check_outputs((file, learning["labels"], learning["demonstrators"]), report, weights)
    stream = is_streamed(stream, scheduler)
    learning["features"] = learning["features"].replace("auto", "folded")  # as in judging: no other policy is kept
    with stages(quiet) as progress:
        if weights:
            from rpil.data.formats.weights import check_weights

            check_weights(weights)
        with cluster(scheduler) as engine:
            data = read(file, progress, stream)
            found = fit_rpil(file, data, progress, boxed=not json_wanted, engine=engine, **learning).audit_
        seconds = time.perf_counter() - start
        if weights:
            from rpil.data.formats.weights import write_weights

            progress("writing the weights")
            write_weights(weights, found.ids, found.offsets, found.step_weight, found.expert_proba, found.log_odds)
        if report:
            progress("writing the report")
            from rpil.audit.html.page import Article, write_page

            write_page(report, [Article(f"Audit of {Path(file).name}", found, file, seconds=seconds)])
    if json_wanted:
        click.echo(as_json(found.to_dict() | ({"suggested": found.suggest_labels(suggest)} if suggest else {})))
    else:
        show_audit(found)
        if suggest:
            click.echo(suggestion(found, suggest))
        _explain(ctx, found, quiet)
    _say_where("Weights", weights, json_wanted)
    _say_where("Report", report, json_wanted)


@main.command()
@click.argument("file")
@click.option("-o", "--output", metavar="POLICY", required=True, help="Where to save the policy; any name will do.")
@click.option(
    "--method",
    type=click.Choice(("rpil", "cloning", "rment")),
    default="rpil",
    show_default=True,
    help="Trust what can be trusted, all alike, or the N that one policy explains best.",
)
@click.option("--trusted", metavar="N", type=click.IntRange(1), help="How many --method rment trusts.")
@_learning_options
@click.pass_context
def fit(
    ctx: click.Context,
    file: str,
    output: str,
    method: str,
    trusted: int | None,
    quiet: bool,
    stream: bool | None,
    scheduler: str | None,
    **learning: Any,
) -> None:
    """Learn a policy from what can be trusted."""
    told = {what for what in ("labels", "demonstrators", "resume") if learning[what]}
    chosen = {"adversary", "minority"}
    told |= {what for what in chosen if ctx.get_parameter_source(what) is ParameterSource.COMMANDLINE}
    if method != "rpil" and told:
        said = f"--{min(told)} means nothing to --method {method}: leave it out, or use --method rpil"
        raise click.UsageError(said, ctx)
    if method != "rpil" and (stream or scheduler):
        what = "--scheduler" if scheduler else "--stream"
        raise click.UsageError(f"--method {method} needs all data in memory: leave out {what}", ctx)
    if (method == "rment") != (trusted is not None):
        raise click.UsageError("--method rment and --trusted N need each other: give both or neither", ctx)
    check_outputs((file, learning["labels"], learning["demonstrators"]), output)
    stream = is_streamed(stream, scheduler)
    with stages(quiet) as progress:
        demonstrations = read(file, progress, stream)
        progress("starting")
        from rpil.estimators.cloning import BehavioralCloning
        from rpil.estimators.persistence import save

        model: Any
        if method == "cloning":
            progress("learning")
            model = BehavioralCloning(features=learning["features"]).fit(in_memory(demonstrations))
        elif trusted is not None:
            from rpil.estimators.rment import RMEnt

            progress("learning")
            model = RMEnt(trusted, learning["features"], random_state=learning["seed"]).fit(in_memory(demonstrations))
        else:
            with cluster(scheduler) as engine:
                model = fit_rpil(file, demonstrations, progress, boxed=True, engine=engine, **learning)
        save(model, output)
    size = f"{len(demonstrations):,} demonstrations ({demonstrations.n_steps:,} steps)"
    if method == "cloning":
        click.echo(f"All of {size} were trusted alike.")
    elif method == "rment":
        click.echo(f"Trusted were {trusted:,} of {size}, those that one policy explains best.")
    else:
        click.echo(f"{finding(model.audit_)}\n{headline(model.audit_)}")
        _explain(ctx, model.audit_, quiet, f"Until then the policy in {output} has learned from both groups.")
    play = shlex.join(["rpil", "evaluate", output, "--env"])
    click.echo(f"Policy: {output}" if quiet else f"Policy: {output}; to play it: {play} ID")


@main.command()
@click.argument("policy")
@click.option("--env", metavar="ID", required=True, help="Gymnasium's name of the environment, as LunarLander-v3.")
@click.option("--episodes", type=click.IntRange(1), default=100, show_default=True, help="How many to play.")
@_json
@_seed
@_quiet
def evaluate(policy: str, env: str, episodes: int, json_wanted: bool, seed: int, quiet: bool) -> None:
    """Play a saved policy: its mean return."""
    with counter(f"playing {env}", quiet) as progress:
        from rpil.estimators.persistence import load
        from rpil.simulation.rollouts import rollout

        found = rollout(load(policy), env, n_episodes=episodes, seed=seed, progress=progress)
    if json_wanted:
        click.echo(as_json({"mean": found.mean, "ci95": found.ci95, "returns": found.returns.tolist()}))
    elif episodes == 1:
        click.echo(f"Return {found.mean:.1f} in one episode of {env}.")
    else:
        low, high = found.ci95
        interval = f"95 % interval {low:.1f} to {high:.1f}"
        click.echo(f"Mean return {found.mean:.1f} ({interval}) over {episodes:,} episodes of {env}.")


@main.command()
@click.option("--env", metavar="ID", required=True, help="An environment with a built-in expert, as MountainCar-v0.")
@click.option("--kind", type=click.Choice(KINDS), required=True, help="What is wrong with the bad demonstrations.")
@click.option("--good", type=click.IntRange(0), required=True, help="How many the expert gives.")
@click.option("--bad", type=click.IntRange(0), required=True, help="How many are spoiled.")
@click.option("-o", "--output", metavar="FILE", required=True, help="A .parquet, .csv or .npz file to write.")
@_seed
@_quiet
def simulate(env: str, kind: str, good: int, bad: int, output: str, seed: int, quiet: bool) -> None:
    """Make demonstrations of known quality.

    The good ones come first. The truth is kept in the columns is_good and episode_return, which no method reads.
    """
    check_outputs((), output)
    with stages(quiet) as progress:
        from rpil.data import formats

        formats.check_format(output)
        progress(f"playing {good + bad} episodes of {env}")
        from rpil.data.demonstrations import Demonstrations
        from rpil.simulation.simulate import simulate

        made = simulate(env, kind, n_good=good, n_bad=bad, seed=seed)
        demonstrations = Demonstrations.from_episodes(made.episodes, source=env)
        truth = {"is_good": made.is_good, "episode_return": made.returns}
        formats.write(output, demonstrations, truth)
    click.echo(
        f"{good} good and {bad} bad ({kind}) demonstrations of {env}, {demonstrations.n_steps:,} steps: {output}"
    )
    if not quiet:
        click.echo(f"Next: {shlex.join(['rpil', 'audit', output])}")


@main.command()
@click.option("--episodes", type=click.IntRange(2), default=100, show_default=True, help="To play with each policy.")
@click.option(
    "-o", "--report", metavar="OUT.html", default="rpil-demo.html", show_default=True, help="Where to write the report."
)
@_json
@_seed
@_quiet
def demo(episodes: int, report: str, json_wanted: bool, seed: int, quiet: bool) -> None:
    """See it work, without any data of yours.

    On people who cook together, and on a lunar lander that must not crash.
    """
    check_outputs((), report)
    with stages(quiet) as progress:
        from rpil.cli.demo import run

        found = run(episodes=episodes, seed=seed, progress=progress)
        progress("writing the report")
        found.write_report(report)
    if json_wanted:
        click.echo(as_json(found.to_dict()))
    else:
        for line in found.lines():
            click.echo(line)
    _say_where("Report", report, json_wanted)


def _explain(ctx: click.Context, audit: Audit, quiet: bool, warning: str = "") -> None:
    """Say what to do next: if two groups compete, which demonstration to label, and the command to run then."""
    if audit.identifiable:
        if not quiet:
            click.echo(advice(audit))
        return
    labels = ctx.params["labels"] or "labels.csv"
    words = ["rpil", str(ctx.info_name)]
    for param in ctx.command.params:
        name, value = str(param.name), ctx.params[str(param.name)]
        if isinstance(param, click.Argument):
            words.append(value)
        elif name != "labels" and ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            flag = {True: param.opts[:1], False: param.secondary_opts[:1]}
            words += flag[value] if isinstance(value, bool) else [param.opts[0], str(value)]
    show_ambiguity(audit, labels, warning)
    click.echo(f"Then run: {shlex.join([*words, '--labels', labels])}")


def _say_where(what: str, path: str | None, json_wanted: bool) -> None:
    if path:
        click.echo(f"{what}: {path}", err=json_wanted)
