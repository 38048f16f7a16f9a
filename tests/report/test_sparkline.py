"""A curve in one line."""

from paddlectl.report.sparkline import BLOCKS, LETTERS, sparkline


def test_a_bar_stands_between_nothing_and_one():
    assert sparkline([number / 7 for number in range(8)], 40) == BLOCKS
    assert sparkline([0.0, 0.5], 40) == "▁▅"
    assert sparkline([0.0, 25.0, 50.0], 40) == "▁▅█", "or the largest"
    assert sparkline([-1.0, 1.0], 40) == "▁█"


def test_many_values_are_means():
    assert sparkline([0.0] * 50 + [1.0] * 50, 4) == "▁▁██"
    assert sparkline([0.0, 1.0] * 50, 2) == "▅▅"
    assert len(sparkline([0.5] * 100, 33)) == 33


def test_nothing_is_nothing():
    assert sparkline([], 40) == ""


def test_an_encoding_that_lacks_a_block_gets_letters_alone():
    values = [number / 7 for number in range(8)]
    for encoding in ("ascii", "latin-1", "cp437"):
        assert sparkline(values, 40, encoding) == LETTERS
    assert len({*LETTERS}) == len(BLOCKS)
