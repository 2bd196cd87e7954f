"""A copy of the packages, in which a test may add to them what it likes."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]


@dataclass(frozen=True)
class Tree:
    """A copy of the packages that a recipe is applied to."""

    root: Path

    def new(self, path: str, text: str) -> None:
        """A file that was not there."""
        assert not (self.root / path).exists(), f"{path} is no new file"
        (self.root / path).write_text(text, encoding="utf-8")

    def after(self, path: str, anchor: str, text: str) -> None:
        """`text` on the lines behind the first line that is or begins with `anchor`."""
        lines = (self.root / path).read_text(encoding="utf-8").splitlines(keepends=True)
        place = next((place for place, line in enumerate(lines, 1) if line.strip().startswith(anchor)), None)
        assert place is not None, f"{path} has no line that begins with {anchor!r}: mend this test and the recipe"
        (self.root / path).write_text("".join([*lines[:place], text, *lines[place:]]), encoding="utf-8")

    def within(self, path: str, old: str, new: str) -> None:
        """`new` in the one place where `old` stood."""
        text = (self.root / path).read_text(encoding="utf-8")
        assert text.count(old) == 1, f"{path} has not {old!r} once: mend this test and the recipe"
        (self.root / path).write_text(text.replace(old, new), encoding="utf-8")

    def python(self, *arguments: str | Path) -> str:
        """What Python prints when it runs in the copy."""
        environment = {**os.environ, "PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1"}
        done = subprocess.run(
            [sys.executable, *arguments], cwd=self.root, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    def wayfix(self, *arguments: str | Path) -> str:
        """What the copy's `wayfix` prints."""
        return self.python("-c", "from shore.main import main; raise SystemExit(main())", *arguments)

    def on_board(self, *arguments: str | Path) -> str:
        """What the copy's `wayfix-onboard` prints."""
        return self.python("-c", "from onboard.main import main; raise SystemExit(main())", *arguments)

    @property
    def touched(self) -> set[str]:
        """Files that are new here or differ from the repository's."""
        files = {str(path.relative_to(self.root)) for path in self.root.rglob("*.py")}
        return {
            name
            for name in files
            if not (REPOSITORY / name).exists() or (REPOSITORY / name).read_bytes() != (self.root / name).read_bytes()
        }
