#!/usr/bin/python3
"""Prints what a run of `ctest -T Test` skipped and why, and the closing line of scripts/test.sh. Exits with 1 when anything
failed or nothing ran. Usage: summarize_tests.py BUILD_FOLDER CTEST_EXIT_CODE EXTRA_PASSED EXTRA_FAILED EXTRA_SKIPPED"""
import collections
import pathlib
import re
import sys
import xml.etree.ElementTree as ElementTree


def main():
    testing = pathlib.Path(sys.argv[1], "Testing")
    ctest_code, passed, failed, skipped = map(int, sys.argv[2:6])
    results = testing / (testing / "TAG").read_text().split()[0] / "Test.xml"
    for test in ElementTree.parse(results).getroot().findall("Testing/Test"):
        name, output = test.findtext("Name"), test.findtext("Results/Measurement/Value") or ""
        ended = test.findtext("Results/NamedMeasurement[@name='Completion Status']/Value") or ""
        # What GoogleTest prints about the cases that it leaves out.
        reasons = collections.Counter(reason.strip() for reason in re.findall(r": Skipped\n(.*)$", output, re.MULTILINE))
        if test.get("Status") == "passed":
            passed += 1
            for reason, count in reasons.items():
                print(f"{count} cases left out of {name}: {reason}")
        elif test.get("Status") == "notrun" and ended.startswith(("SKIP", "Disabled")):
            skipped += 1
            print(f"skipped: {name}: {next(iter(reasons), (output.strip().splitlines() or [ended])[-1])}")
        else:
            failed += 1
            print(f"failed: {name}")
    if ctest_code != 0 and failed == 0:
        failed += 1
        print(f"failed: ctest ended with {ctest_code}")
    print(f"{passed} passed, {failed} failed, {skipped} skipped")
    sys.exit(failed > 0 or passed == 0)


if __name__ == "__main__":
    main()
