"""What the extraction could not honour, as plain records for the panel, the command line and JSON."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Warning:
    """One thing that the picture shows otherwise than the file says.

    text : a sentence for the user: what was met, what is done instead
    object, material : the names of what it was met on; empty where it does not apply
    """

    text: str
    object: str = ""
    material: str = ""

    def __str__(self) -> str:
        places = [f"material '{self.material}'"] if self.material else []
        if self.object:
            places.append(f"object '{self.object}'")
        return f"{', '.join(places)}: {self.text}" if places else self.text


@dataclass
class WarningList:
    """Collects warnings; the same one twice counts once."""

    _records: dict[Warning, None] = field(default_factory=dict)

    def add(self, text: str, object: str = "", material: str = "") -> None:
        """Add one record unless it is there already."""
        self._records.setdefault(Warning(text, object, material))

    def include(self, records: Iterable[Warning]) -> None:
        """Add records of another list."""
        for record in records:
            self._records.setdefault(record)

    @property
    def records(self) -> tuple[Warning, ...]:
        """All records, in the order they were met."""
        return tuple(self._records)
