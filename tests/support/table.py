"""Tables of cases that are one test: `each_row` in place of `pytest.mark.parametrize`."""

import functools
import inspect
import reprlib


def each_row(names, table):
    """Run a test for each row of a table, as one case whose failing rows are shown separately.

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
            folder = fixtures.get("tmp_path")
            for number, row in enumerate(table):
                if folder:
                    fixtures["tmp_path"] = folder / f"row{number}"
                    fixtures["tmp_path"].mkdir()
                with subtests.test(f"row {number}: {reprlib.repr(row)}"):
                    test(**fixtures, **dict(zip(names, row, strict=True)))

        case.__signature__ = inspect.Signature(outer)
        return case

    return decorated
