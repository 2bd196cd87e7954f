"""`make golden`: writes what a case gives now over what was expected, where that differs. Read its `git diff`."""

from pathlib import Path

from shore.logbook.estimate_rounding import TOLERANCE
from shore.trips.golden_case import CASE, differences, read_case, write_expected

HERE = Path(__file__).parent


def main() -> None:
    for path in sorted(HERE.glob(f"*/{CASE}")):
        case = read_case(path.parent)
        if found := differences(case):
            write_expected(case)
        how = f"{len(found)} values are others" if found else "as expected"
        where = (
            f"; it {case.other_arithmetic}: compared within {TOLERANCE:g}" if case.other_arithmetic else ", every bit"
        )
        print(f"{case.name}: {how}{where}")
    print("read the difference before you commit it: git diff tests/golden")


if __name__ == "__main__":
    main()
