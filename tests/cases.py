"""Where the small inputs that once failed lie: beside the repository, never in it."""

from pathlib import Path

import pytest

CASES = Path(__file__).parents[2] / "shared" / "cases"

needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason="the small inputs are not here: ../shared/cases is absent")
"""Mark of a test that reads one of them."""
