import sys
from pathlib import Path

# The harness is no test and belongs to no package: found by its folder.
sys.path.insert(0, str(Path(__file__).parent))
