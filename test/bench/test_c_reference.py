# SPDX-License-Identifier: Apache-2.0
"""Facts about the comparison with a program in C."""

from __future__ import annotations

import pytest

from adaptive_blf_control.bench.bench import main
from adaptive_blf_control.bench.c_reference import against_c, compiler, PerStep
from adaptive_blf_control.errors import BlfError

PROGRAM = '#include <stdio.h>\nint main(void) {{ puts("{}"); return 0; }}\n'


@pytest.fixture
def program(tmp_path):
    """Return ``program(text)``: a source whose program prints the text."""
    if compiler() is None:
        pytest.skip('no C compiler here')

    def write(text: str):
        source = tmp_path / 'reference.c'
        source.write_text(PROGRAM.format(text), encoding='utf-8')
        return source

    return write


def test_the_ratio_is_that_of_the_medians(program, repository):
    measured = against_c(program('2.5 us/step'), repository / 'config' / 'two_link.yaml', 0.02, 3)
    assert measured.c == 2.5
    assert measured.ratio == pytest.approx(measured.ours / 2.5)
    assert PerStep(1.0, 4.0).ratio == 0.25


def test_a_program_that_prints_no_time_is_refused(program, repository):
    with pytest.raises(BlfError, match=r"printed 'hello.*expected its time per step"):
        against_c(program('hello'), repository / 'config' / 'two_link.yaml', 0.01, 1)


def test_a_source_that_does_not_compile_is_refused_with_the_compilers_words(tmp_path, repository):
    if compiler() is None:
        pytest.skip('no C compiler here')
    source = tmp_path / 'broken.c'
    source.write_text('int main(void) { return x; }\n', encoding='utf-8')
    with pytest.raises(BlfError, match='broken.c.*error'):
        against_c(source, repository / 'config' / 'two_link.yaml', 0.01, 1)


def test_without_a_program_the_part_is_skipped_with_the_reason(repository, capsys):
    assert main(['against_c', '--c-reference', 'nowhere.c',
                 '--config', str(repository / 'config')]) == 0
    assert 'Skipped: --c-reference nowhere.c is no file' in capsys.readouterr().out
