"""The benchmark's numbers as Markdown tables, for the terminal and for the report."""

from __future__ import annotations

import statistics

from tests.benchmarks.equal_error import FEWEST
from tests.benchmarks.peers_blender import BVH_TREE, SCENE
from tests.benchmarks.peers_libraries import OPEN3D
from tests.benchmarks.peers_nodes import RAYCAST
from tests.benchmarks.peers_ours import CERTIFIED, FLOAT64
from tests.benchmarks.pictures import CYCLES
from tests.benchmarks.truth import bound_rate, count_failures

NOTHING = "-"
COUNTS = ("false_misses", "false_hits", "wrong_primitives")


def write_tables(numbers):
    """Return all tables that there are numbers for."""
    writers = (describe_run, write_accuracy, write_speed, write_equal_error, write_pictures)
    return "\n".join(line for write in writers for line in write(numbers))


def describe_run(numbers):
    """Return the lines that say when, where and with what the numbers were measured."""
    machine, settings = numbers["machine"], numbers["settings"]
    load = "" if machine["load"] is None else f", load {machine['load']:.1f} at the start"
    versions = sorted(set(numbers["versions"].values()))
    lines = [
        f"- {machine['date']}, {machine['processor']}, {machine['cores']} cores{load}, {machine['system']}",
        f"- Python {machine['python']}, {', '.join(versions)}",
        f"- seed {settings['seed']}, {settings['rays']} rays per set, {settings['speed_rays']} per speed batch, "
        f"processor time, median of {settings['rounds']} rounds, one core, peers taking turns",
    ]
    if numbers.get("equal_error"):
        width, height = settings["picture_size"]
        renders = f"{settings['picture_renders']} renders of {FEWEST} to {settings['picture_samples']} samples"
        lines.append(f"- equal error: {width}x{height} pixels, {renders}, engines taking turns, medians")
    return [*lines, *(f"- skipped {name}: {reason}" for name, reason in numbers["skipped"].items()), ""]


def write_accuracy(numbers):
    """Return the lines of sections accuracy, spheres and cost."""
    lines = []
    for section, title in (("accuracy", "Triangles"), ("spheres", "Spheres")):
        rows = numbers.get(section)
        if rows:
            lines += [f"## {title}: every peer over all sets", "", *make_table(SUMMARY, summarise_peers(rows)), ""]
            lines += [f"## {title}: wrong answers per million", "", *pivot(rows, show_failures), ""]
            lines += [f"## {title}: |dt|, 99th percentile, ulps of float64", "", *pivot(rows, show_error), ""]
    if numbers.get("cost"):
        lines += ["## What certainty costs", "", *make_table(COST, [show_cost(row) for row in numbers["cost"]]), ""]
    return lines


def write_speed(numbers):
    """Return the lines of section speed."""
    if not numbers.get("speed"):
        return []
    rows = numbers["speed"]
    lines = ["## Million rays per second", "", *pivot(rows, lambda row: show(row["mrays_per_second"])), ""]
    lines += ["## Certified mode over others", "", *make_table(RATIOS, list_ratios(rows)), ""]
    builds = [row | {"family": "build"} for row in numbers["builds"]]
    return [*lines, "## Seconds from arrays to the first answer", "", *pivot(builds, lambda r: show(r["seconds"])), ""]


def write_pictures(numbers):
    """Return the lines of the sections that render pictures with ours alone, or few of Cycles'."""
    lines = []
    for section, title, header, cells in PICTURE_TABLES:
        rows = numbers.get(section)
        if rows:
            lines += [f"## {title}", "", *make_table(header, [cells(row) for row in rows]), ""]
    return lines


def write_equal_error(numbers):
    """Return the lines of section equal_error: ratios, their means, and what they come from."""
    rows = numbers.get("equal_error")
    if not rows:
        return []
    titles, shares = (list(level) for level in (rows[0]["ratios"], rows[0]["ratios"][CYCLES]))
    ratios = [
        [row["scene"], row["light"], name, *(show_compared(row["ratios"][title][name]) for title in titles)]
        for row in rows
        for name in shares
    ]
    means = [
        ["all", light, name, *(show_means([row["ratios"][title][name] for row in own]) for title in titles)]
        for light, own in group_by(rows, "light").items()
        for name in shares
    ]
    curves = [show_curve(row, engine, curve) for row in rows for engine, curve in row["curves"].items()]
    header = ("scene", "light", "pixels", *titles)
    return [
        "## Time over ours at equal error", "", *make_table(header, ratios), "",
        "## Geometric means, and the least", "", *make_table(header, means), "",
        "## Error and cost by samples", "", *make_table(CURVES, curves), "",
    ]  # fmt: skip


def group_by(rows, name):
    """Return value of a field -> rows, in their order."""
    values = dict.fromkeys(row[name] for row in rows)
    return {value: [row for row in rows if row[name] == value] for value in values}


# Cells --------------------------------------------------------------------------------------------------------------


def show(value):
    """Three digits, or a dash for no number."""
    if value is None:
        return NOTHING
    if value == 0:
        return "0"
    return f"{value:.0f}" if 100 <= abs(value) < 1e7 else f"{value:.3g}"


def show_ratio(value):
    """Two decimals, or a dash for no number."""
    return NOTHING if value is None else f"{value:.2f}"


def show_compared(compared):
    """A ratio with its standard error in percent, and the error at which it was read."""
    if compared is None:
        return NOTHING
    spread = "" if compared["spread"] is None else f" +- {compared['spread']:.0%}"
    return f"{compared['ratio']:.2f}{spread} at {compared['error']:.2%}"


def show_means(compared):
    """The geometric mean of ratios, the least of them, and how many there are; a dash for none."""
    ratios = [each["ratio"] for each in compared if each is not None]
    if not ratios:
        return NOTHING
    return f"{statistics.geometric_mean(ratios):.2f}, least {min(ratios):.2f}, of {len(ratios)}"


def show_curve(row, engine, curve):
    """Return the cells of a line of the CURVES table."""
    process = row["process"].get(engine)
    return [
        row["scene"], row["light"], engine,
        f"{curve['samples'][0]} to {curve['samples'][-1]}",
        f"{curve['errors']['all'][0]:.2%} to {curve['errors']['all'][-1]:.2%}",
        *(show_ratio(slope) for slope in curve["slopes"].values()),
        f"{curve['noise_in_1%']:.0%}", show(curve["microseconds"]), show(curve["start"]), show(process),
    ]  # fmt: skip


def show_rate(failures, rays):
    """Wrong answers per million; for none the bound on what may have been overlooked."""
    rate = bound_rate(failures, rays)
    if rate["rate_bound_per_million"] is not None:
        return f"0 (< {show(rate['rate_bound_per_million'])})"
    return show(rate["failures_per_million"])


def show_failures(row):
    """Wrong answers per million of a row."""
    return show(row["failures_per_million"])


def show_error(row):
    """The 99th percentile of |dt|."""
    return show(row["dt_p99"])


# Tables -------------------------------------------------------------------------------------------------------------

SUMMARY = (
    "peer", "rays", "false misses / M", "false hits / M", "wrong primitives / M",
    "dt median, ulps", "dt p99, worst set", "dt max", "bounds broken", "bound p99", "to integers", "ns / ray",
)  # fmt: skip
CURVES = (
    "scene", "light", "engine", "samples", "error", "p", "p without 1%", "p without 5%", "noise in 1%",
    "us / sample", "start, s", "process, s",
)  # fmt: skip
COST = ("scene", "family", "rays", "certified ns", "float64 ns", "ratio", "promised", "to integers")
PICTURE_TABLES = (
    (
        "convergence", "Error against samples",
        ("scene", "sampling", "samples", "error", "slope"),
        lambda row: [row["scene"], row["sampling"], str(row["samples"]), show(row["error"]), f"{row['slope']:.2f}"],
    ),
    (
        "ablation", "What features cost, nanoseconds a camera ray",
        ("feature", "stage", "without", "with", "calls without", "calls with"),
        lambda row: [
            row["feature"], row["stage"], show(row["ns_without"]), show(row["ns_with"]),
            str(row["calls_without"]), str(row["calls_with"]),
        ],
    ),
    (
        "memory", "Peak of the resident memory, MB",
        ("task", "at the start", "peak", "over the start"),
        lambda row: [
            row["task"], show(row["start_mb"]), show(row["peak_mb"]), show(row["peak_mb"] - row["start_mb"]),
        ],
    ),
    (
        "workers", "Workers, seconds by the clock",
        ("samples", "one", "two", "ratio"),
        lambda row: [str(row["samples"]), show(row["one"]), show(row["two"]), f"{row['ratio']:.2f}"],
    ),
)  # fmt: skip
RATIOS = ("scene", "family", "over Embree", "over BVHTree", "over Scene.ray_cast", "over Raycast node", "over float64")


def make_table(header, rows):
    """Return the lines of a Markdown table; `rows` are sequences of strings."""
    ruler = ["---"] + ["---:"] * (len(header) - 1)
    return [f"| {' | '.join(cells)} |" for cells in (header, ruler, *rows)]


def pivot(rows, cell):
    """Return a table with one line per scene and family, one column per peer."""
    peers = list(dict.fromkeys(row["peer"] for row in rows))
    cells = {(row["scene"], row["family"], row["peer"]): cell(row) for row in rows}
    sets = list(dict.fromkeys((row["scene"], row["family"]) for row in rows))
    lines = [
        [f"{scene}, {family}", *(cells.get((scene, family, peer), NOTHING) for peer in peers)] for scene, family in sets
    ]
    return make_table(["set", *peers], lines)


def pool(rows):
    """Return peer -> its rows."""
    peers = dict.fromkeys(row["peer"] for row in rows)
    return {peer: [row for row in rows if row["peer"] == peer] for peer in peers}


def total(rows, name):
    """Sum a column, None where no row has a number."""
    values = [row[name] for row in rows if row[name] is not None]
    return sum(values) if values else None


def reduce(statistic, rows, name):
    """Apply a statistic to the numbers of a column; None where there are none."""
    values = [row[name] for row in rows if row[name] is not None]
    return statistic(values) if values else None


def summarise_peers(rows):
    """Return the lines of the SUMMARY table: counts are pooled, errors the median or worst of the sets."""
    lines = []
    for peer, own in pool(rows).items():
        rays = total(own, "rays")
        shares = [row["exact_share"] * row["rays"] for row in own if row["exact_share"] is not None]
        lines.append([
            peer, str(rays), *(show_rate(total(own, name), rays) for name in COUNTS),
            show(reduce(statistics.median, own, "dt_median")), show(reduce(max, own, "dt_p99")),
            show(reduce(max, own, "dt_max")), show(total(own, "bound_violations")), show(reduce(max, own, "bound_p99")),
            f"{100 * sum(shares) / rays:.2g}%" if shares else NOTHING,
            show(reduce(statistics.median, own, "ns_per_ray")),
        ])  # fmt: skip
    return lines


def show_cost(row):
    """Return the cells of a line of the COST table."""
    return [
        row["scene"], row["family"], str(row["rays"]), show(row["certified_ns"]), show(row["float64_ns"]),
        f"{row['ratio']:.2f}", f"<= {row['promised']:g}", f"{100 * row['exact_share']:.2g}%",
    ]  # fmt: skip


def list_ratios(rows):
    """Return the lines of the RATIOS table: speed of the certified mode over that of each other."""
    speeds = {(row["scene"], row["family"], row["peer"]): row["mrays_per_second"] for row in rows}
    lines = []
    for scene, family in dict.fromkeys((row["scene"], row["family"]) for row in rows):
        ours = speeds.get((scene, family, CERTIFIED))
        others = [speeds.get((scene, family, peer)) for peer in (OPEN3D, BVH_TREE, SCENE, RAYCAST, FLOAT64)]
        ratios = [f"{ours / other:.2f}" if ours and other else NOTHING for other in others]
        lines.append([scene, family, *ratios])
    return lines


def pool_failures(rows, families):
    """Return peer -> (wrong answers, rays) over the rows of some families."""
    pooled = {}
    for peer, own in pool(rows).items():
        chosen = [row for row in own if row["family"] in families]
        pooled[peer] = sum(count_failures(row) for row in chosen), sum(row["rays"] for row in chosen)
    return pooled
