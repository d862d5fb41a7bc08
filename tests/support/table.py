"""Tables of cases that are one test: `each_row` in place of `pytest.mark.parametrize`."""

import functools
import inspect
import reprlib

import pytest


def each_row(names, table):
    """Run a test for each row of a table, as one case whose failing and skipped rows are shown separately.

    A case costs half a millisecond before it runs, in each process of the tests. Rows share the fixtures of their case, but for
    `tmp_path`, which is a folder of its own for each. Where that is not enough: `pytest.mark.parametrize`.
    """
    names = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    table = [row if len(names) > 1 else (row,) for row in table]
    assert table, "expected rows, got none"

    def decorated(test):
        inner = inspect.signature(test).parameters
        outer = [parameter for name, parameter in inner.items() if name not in names]
        if "subtests" not in inner:
            outer.append(inspect.Parameter("subtests", inspect.Parameter.KEYWORD_ONLY))

        @functools.wraps(test)
        def case(**fixtures):
            subtests = fixtures["subtests"]
            if "subtests" not in inner:
                del fixtures["subtests"]
            folder, skipped = fixtures.get("tmp_path"), 0
            for number, row in enumerate(table):
                if folder:
                    fixtures["tmp_path"] = folder / f"row{number}"
                    fixtures["tmp_path"].mkdir()
                shown = f"row {number}: {reprlib.repr(row)}"
                with subtests.test(shown):
                    try:
                        test(**fixtures, **dict(zip(names, row, strict=True)))
                    except pytest.skip.Exception as skip:
                        skipped += 1
                        pytest.skip(f"{shown}: {skip.msg}")  # pytest shows equal reasons as one
            if skipped == len(table):
                pytest.skip("each row was skipped")

        case.__signature__ = inspect.Signature(outer)
        return case

    return decorated
