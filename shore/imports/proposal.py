"""Proposal of a mapping on its way to a person: tables, comments on what is not sure, and questions (TOML text)."""

from dataclasses import dataclass, field
from typing import Any

from common.settings import convert
from common.simulation.column_map import IMPORT, ColumnMap
from common.toml_text import toml_lines


@dataclass(slots=True)
class Proposal:
    """A mapping on its way, with a comment for each key that is not sure."""

    tables: dict[str, dict[str, Any]]
    comments: dict[tuple[str, str], str] = field(default_factory=dict)
    above: list[str] = field(default_factory=list)
    """Comments on the whole."""
    questions: dict[str, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    """Questions that only a person can answer, by table, each with the lines of which one is right."""

    def mapping(self) -> ColumnMap:
        """The mapping that the tables are."""
        return convert(self.tables, ColumnMap, "the proposal", use=IMPORT)

    def text(self) -> str:
        """The mapping as TOML."""
        lines, table = [f"# {line}" for line in self.above], ""
        for line in toml_lines(self.tables):
            if line.startswith("\n["):
                table = line.strip("\n[]")
            comment = self.comments.get((table, line.partition(" = ")[0]))
            lines.append(f"{line}  # {comment}" if comment else line)
            if line.startswith("\n[") and table in self.questions:
                question, answers = self.questions[table]
                lines += [f"# QUESTION: {question} Take the # from one of these lines:", *(f"# {it}" for it in answers)]
        return "\n".join(lines) + "\n"
