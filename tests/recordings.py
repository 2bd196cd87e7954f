"""Where the real recordings lie: beside the repository, never in it."""

from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
SHARED_DATA = REPOSITORY.parent / "shared" / "data"
BLUEBOAT = SHARED_DATA / "blueboat-usv"
BLUEBOAT_235 = BLUEBOAT / "fixed_00000235.csv"
BLUEBOAT_MAP = REPOSITORY / "deploy" / "examples" / "blueboat-map.toml"
