"""The benchmark's numbers as plots."""

from __future__ import annotations

import statistics

import matplotlib
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from tests.benchmarks.tables import pool, pool_failures, reduce
from tests.benchmarks.truth import bound_rate

AIMED = ("vertex", "edge", "vertical vertex", "vertical edge")
FAMILIES = {"at vertices": AIMED[::2], "at edges": AIMED[1::2], "grazing": ("grazing",), "random": ("random", "camera")}
MARKERS = {"raytracer": "*", "Blender": "s", "Embree": "o", "Mitsuba": "D", "trimesh": "^", "lecture": "v"}
RESOLUTION = 110
# An error of nothing has no place on a logarithmic axis: it is drawn here, half an ulp rounded down.
SMALLEST_ERROR = 0.1


def choose_style(peers):
    """Return peer -> (color, marker): one color each, markers by kind."""
    colors = matplotlib.colormaps["tab20"].colors
    order = [*range(0, 20, 2), *range(1, 20, 2)]
    return {
        peer: (colors[order[k]], next((mark for name, mark in MARKERS.items() if peer.startswith(name)), "P"))
        for k, peer in enumerate(peers)
    }


def save(figure, path, caption):
    """Write a figure with a line on what it was measured on."""
    figure.supxlabel(caption, x=0.995, ha="right", fontsize=6, color="0.4")
    figure.savefig(path, dpi=RESOLUTION, metadata={"Software": None})


def plot_error_against_time(numbers, path, caption):
    """Wrong answers, and |dt|, against nanoseconds per ray, both logarithmic; hollow = none, drawn at the 95% bound."""
    rows = numbers["accuracy"]
    style = choose_style(pool(rows))
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    wrong, error = figure.subplots(1, 2)
    failures = pool_failures(rows, AIMED)
    for peer, own in pool(rows).items():
        color, marker = style[peer]
        look = {"marker": marker, "markersize": 13 if marker == "*" else 8, "linestyle": "none", "color": color}
        time = reduce(statistics.median, own, "ns_per_ray")
        rate = bound_rate(*failures[peer])
        clean = rate["rate_bound_per_million"]
        face = {"markerfacecolor": "white", "markeredgewidth": 1.8} if clean else {}
        wrong.plot(time, clean or rate["failures_per_million"], **look, **face)
        ulps = reduce(statistics.median, own, "dt_p99")
        error.plot(time, max(ulps, SMALLEST_ERROR), **look, label=peer)
    wrong.set(
        title="rays exactly at vertices and edges (hollow: none wrong, 95% bound)", ylabel="wrong answers per million"
    )
    error.set(title="all rays: |dt|, 99th percentile, median set", ylabel="ulps of float64")
    for axes in (wrong, error):
        axes.set(xscale="log", yscale="log", xlabel="nanoseconds per ray")
        axes.title.set_fontsize(10)
        axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=8)
    save(figure, path, caption)


def plot_failures(numbers, path, caption):
    """Wrong answers per million by peer and family, logarithmic; a 0 where none was seen."""
    rows = numbers["accuracy"]
    peers = list(pool(rows))
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    axes = figure.subplots()
    width = 0.8 / len(FAMILIES)
    for k, (label, families) in enumerate(FAMILIES.items()):
        failures = pool_failures(rows, families)
        rates = [bound_rate(*failures[peer])["failures_per_million"] or 0.0 for peer in peers]
        places = [place + (k - (len(FAMILIES) - 1) / 2) * width for place in range(len(peers))]
        axes.bar(places, [max(rate, 1.0) for rate in rates], width, label=label)
        for place, rate in zip(places, rates, strict=True):
            if rate == 0:
                axes.text(place, 1.1, "0", ha="center", va="bottom", fontsize=7, color="0.35")
    axes.set(yscale="log", ylim=(1, 5e6), ylabel="wrong answers per million")
    axes.set_xticks(range(len(peers)), [peer.replace(" ", "\n").replace(".", ".\n") for peer in peers], fontsize=7)
    axes.grid(axis="y", alpha=0.3)
    axes.legend(title="rays", fontsize=8, ncols=4, loc="upper left")
    save(figure, path, caption)


def plot_speed(numbers, path, caption):
    """Million rays per second by kind of rays, scene and peer, logarithmic."""
    rows = numbers["speed"]
    kinds, scenes = (list(dict.fromkeys(row[key] for row in rows)) for key in ("family", "scene"))
    style = choose_style(pool(rows))
    figure = Figure(figsize=(11, 6.4), layout="constrained")
    panels = figure.subplots(-(-len(kinds) // 2), 2, sharey=True, squeeze=False).ravel()
    width = 0.84 / len(style)
    for axes, kind in zip(panels, kinds, strict=False):
        for k, (peer, own) in enumerate(pool(rows).items()):
            speeds = {row["scene"]: row["mrays_per_second"] for row in own if row["family"] == kind}
            places = [scenes.index(scene) + (k - (len(style) - 1) / 2) * width for scene in speeds]
            axes.bar(places, list(speeds.values()), width, color=style[peer][0], label=peer)
        axes.set(title=f"{kind} rays", yscale="log")
        axes.set_xticks(range(len(scenes)), [scene.replace(" ", "\n") for scene in scenes], fontsize=7)
        axes.grid(axis="y", alpha=0.3)
    for axes in panels[::2]:
        axes.set_ylabel("million rays per second")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    save(figure, path, caption)


def plot_convergence(numbers, path, caption):
    """Error against samples for every way of sampling, both logarithmic; one panel for each scene."""
    rows = numbers["convergence"]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    for axes, scene in zip(figure.subplots(1, len(scenes), squeeze=False)[0], scenes, strict=True):
        own = [row for row in rows if row["scene"] == scene]
        for sampling in dict.fromkeys(row["sampling"] for row in own):
            curve = [row for row in own if row["sampling"] == sampling]
            label = f"{sampling}, slope {curve[0]['slope']:.2f}"
            axes.plot([row["samples"] for row in curve], [row["error"] for row in curve], marker="o", label=label)
        axes.set(title=scene, xscale="log", yscale="log", xlabel="samples", ylabel="noise / mean level")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    save(figure, path, caption)


def plot_equal_error(numbers, path, caption):
    """Error against seconds for every scene and light, both logarithmic; dashed: without the noisiest 1% of pixels."""
    rows = numbers["equal_error"]
    columns = min(len(rows), 4)
    lines = -(-len(rows) // columns)
    figure = Figure(figsize=(2.9 * columns + 1.6, 2.5 * lines + 0.6), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for axes, row in zip(panels, rows, strict=False):
        for engine, curve in row["curves"].items():
            (line,) = axes.plot(curve["seconds"], curve["errors"]["all"], marker="o", markersize=3, label=engine)
            axes.plot(curve["seconds"], curve["errors"]["without 1%"], linestyle="--", color=line.get_color())
        axes.set(xscale="log", yscale="log")
        for axis, steps in ((axes.xaxis, (1.0, 3.0)), (axes.yaxis, (1.0, 2.0, 5.0))):  # within a decade all were named
            axis.set_major_locator(LogLocator(subs=steps))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        axes.set_title(f"{row['scene']}, {row['light']}", fontsize=9)
        axes.grid(alpha=0.3)
    for axes in panels[len(rows) :]:
        axes.set_axis_off()
    for axes in panels[max(len(rows) - columns, 0) : len(rows)]:
        axes.set_xlabel("seconds", fontsize=8)
    figure.supylabel("noise / mean level", fontsize=8)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8)
    save(figure, path, caption)
