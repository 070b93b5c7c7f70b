"""What tests of panels share: a layout that writes down what is asked of it."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import bpy
import pytest

import addon
from addon.properties import ENGINE


@pytest.fixture
def registered() -> Iterator[None]:
    addon.register()
    yield
    addon.unregister()


class RecordingLayout:
    """Stands for a UILayout: checks that every property drawn exists, and keeps names and texts."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.texts: list[str] = []
        self.buttons: list[Any] = []
        self.views: list[Any] = []

    def prop(self, data: Any, name: str, **options: Any) -> None:
        assert name in data.bl_rna.properties, f"{data} has no property {name}"
        self.names.append(name)

    def label(self, text: str = "", **options: Any) -> None:
        self.texts.append(text)

    def operator(self, name: str, **options: Any) -> Any:
        self.buttons.append(SimpleNamespace(name=name))
        return self.buttons[-1]

    def template_node_view(self, tree: Any, node: Any, socket: Any) -> None:
        self.views.append((tree, node, socket))

    def template_curve_mapping(self, data: Any, name: str) -> None:
        self.prop(data, name)

    def template_list(
        self, kind: str, name: str, data: Any, items: str, holder: Any, index: str, **options: Any
    ) -> None:
        assert hasattr(bpy.types, kind)
        self.prop(data, items)
        assert index in holder.bl_rna.properties

    def prop_search(self, data: Any, name: str, found_in: Any, items: str, **options: Any) -> None:
        self.prop(data, name)
        assert items in found_in.bl_rna.properties

    def template_ID(self, data: Any, name: str, new: str) -> None:  # noqa: N802  (Blender's)
        self.prop(data, name)
        self.operator(new)

    def template_light_linking_collection(self, row: Any, data: Any, name: str) -> None:
        self.prop(data, name)

    def menu(self, name: str, **options: Any) -> None:
        assert hasattr(bpy.types, name)

    def separator(self) -> None:
        pass

    def column(self, **options: Any) -> RecordingLayout:
        return self

    split = row = column


def draw(panel: Any, **context: Any) -> RecordingLayout:
    """Return what a panel draws in a context."""
    layout = RecordingLayout()
    preferences = SimpleNamespace(system=SimpleNamespace(ui_scale=1.0))
    defaults = {"scene": bpy.context.scene, "view_layer": bpy.context.view_layer, "light": None}
    surroundings = SimpleNamespace(
        engine=ENGINE, preferences=preferences, region=SimpleNamespace(width=300), **{**defaults, **context}
    )
    for function in (getattr(panel, "draw_header", None), panel.draw):
        if function:
            function(SimpleNamespace(layout=layout), surroundings)
    return layout
