from roadscope.core import unknown

KNOWN = ("nearest", "gnn", "jpda")


def test_the_name_that_may_be_meant_is_suggested_beside_all() -> None:
    assert unknown("tracker", "nearst", KNOWN) == (
        "no tracker 'nearst' (did you mean 'nearest'?); known: nearest, gnn, jpda"
    )


def test_nothing_is_suggested_where_nothing_is_near() -> None:
    assert unknown("tracker", "x", KNOWN) == "no tracker 'x'; known: nearest, gnn, jpda"
    assert unknown("tracker", "", []) == "no tracker ''; known: "


def test_a_long_list_does_not_hide_what_is_suggested() -> None:
    many = [*KNOWN, *(f"number-{k}" for k in range(20))]
    assert unknown("tracker", "nearst", many) == (
        "no tracker 'nearst' (did you mean 'nearest'?); known: nearest and 22 others"
    )
    assert unknown("tracker", "x", many).endswith("number-19")


def test_a_name_is_never_suggested_for_itself() -> None:
    assert "did you mean" not in unknown("tracker", "nearest", KNOWN)
