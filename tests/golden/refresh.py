"""`make golden`: writes what each case gives now over what was expected. Right only when its `git diff` was read."""

from pathlib import Path

from shore.trips.golden_case import CASE, differences, read_case, write_expected

HERE = Path(__file__).parent


def main() -> None:
    for path in sorted(HERE.glob(f"*/{CASE}")):
        case = read_case(path.parent)
        found = differences(case)
        write_expected(case)
        print(f"{case.name}: {f'{len(found)} values beyond the tolerance' if found else 'as expected'}")
    print("read the difference before you commit it: git diff tests/golden")


if __name__ == "__main__":
    main()
