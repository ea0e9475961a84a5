# SPDX-License-Identifier: Apache-2.0
"""Facts about Algorithm 1: the pruned search equals the brute-force one, rank and σ_min hold."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from adaptive_blf_control.compiled import COMPILED
from adaptive_blf_control.errors import ParameterError
from adaptive_blf_control.identification import history_step
from adaptive_blf_control.identification.history_stack import HistoryStack
from adaptive_blf_control.identification.pair_selection import is_different
from adaptive_blf_control.identification.weak_directions import MOST

hypothesis = pytest.importorskip('hypothesis')
st = hypothesis.strategies

EPS = np.finfo(float).eps


def gram_of(regressors: np.ndarray) -> np.ndarray:
    return np.einsum('pni,pnj->ij', regressors, regressors)


def sigma_of(regressors: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(gram_of(regressors))[0])


def brute_force(regressors: np.ndarray, candidate: np.ndarray) -> np.ndarray:
    """Lines 10-13 of Algorithm 1: σ_min with the candidate in each slot."""
    trials = np.repeat(regressors[np.newaxis], len(regressors), axis=0)
    trials[np.arange(len(regressors)), np.arange(len(regressors))] = candidate
    return np.array([sigma_of(trial) for trial in trials])


def true_rank(regressors: np.ndarray) -> int:
    """Rank by the singular values of H, which resolve twice the digits of H Hᵀ."""
    values = np.linalg.svd(regressors.reshape(-1, regressors.shape[-1]), compute_uv=False)
    assert not np.any((values > 1e-10 * values[0]) & (values < 3e-7 * values[0])), 'no clear rank'
    return int(np.count_nonzero(values > 3e-7 * values[0]))


def rounding_of(*arrays: np.ndarray) -> float:
    """Return what an eigenvalue of the sum of Y'Y may be off by."""
    return 50.0 * EPS * sum(float(np.sum(array * array)) for array in arrays)


def filled(regressors: np.ndarray, epsilon: float = 0.0) -> HistoryStack:
    size, n, m = regressors.shape
    stack = HistoryStack(n, m, size, epsilon)
    for slot, regressor in enumerate(regressors):
        assert stack.offer(regressor, regressor.sum(axis=1)) == slot
    return stack


def assert_offer_is_brute_force(stack: HistoryStack, candidate: np.ndarray) -> bool:
    """Offer to a full stack of full rank; return whether the candidate was taken."""
    before = stack.regressors.copy()
    sigmas, old = brute_force(before, candidate), sigma_of(before)
    tolerance = rounding_of(before, candidate)
    slot = stack.offer(candidate, candidate.sum(axis=1))
    if slot < 0:
        assert sigmas.max() <= old + tolerance
        np.testing.assert_array_equal(stack.regressors, before)
        return False
    assert sigmas.max() >= old - tolerance
    assert sigmas[slot] >= sigmas.max() - tolerance  # the very slot, but for ties
    before[slot] = candidate
    np.testing.assert_array_equal(stack.regressors, before)
    return True


def assert_measured(stack: HistoryStack) -> None:
    """Rank, σ_min, Q and the moment are those of the stored pairs."""
    pairs = stack.regressors[:stack.count]
    expected, tolerance = gram_of(pairs), 1e-12 * max(np.sum(pairs * pairs), 1e-300)
    np.testing.assert_allclose(stack.gram, expected, atol=tolerance)
    np.testing.assert_allclose(stack.moment, np.einsum('pni,pn->i', pairs,
                                                       stack.torques[:stack.count]),
                               atol=10 * tolerance)
    assert stack.rank == true_rank(pairs)
    if stack.rank == expected.shape[0]:
        assert stack.sigma_min == pytest.approx(sigma_of(pairs), abs=rounding_of(pairs))
    else:
        assert stack.sigma_min == 0.0


def random_pairs(random: np.random.Generator, kind: str, count: int, n: int, m: int) -> np.ndarray:
    pairs = random.normal(size=(count, n, m))
    if kind == 'scales':
        pairs *= 10.0 ** random.uniform(-2.0, 2.0, (count, 1, 1))
    elif kind == 'columns':
        pairs *= 10.0 ** random.uniform(-1.5, 1.5, m)
    elif kind == 'near duplicates':
        pairs[count // 2:] = pairs[:count - count // 2] * (1.0 + 1e-7)
    elif kind == 'duplicates':
        pairs[count // 2:] = pairs[:count - count // 2]
    elif kind == 'smooth':  # what neighbouring samples look like
        pairs = np.cumsum(0.3 * pairs, axis=0)
    return pairs


KINDS = ('normal', 'scales', 'columns', 'near duplicates', 'duplicates', 'smooth')


@pytest.mark.parametrize('kind', KINDS)
def test_pruned_search_equals_brute_force_on_hundreds_of_random_stacks(kind):
    random, offers, taken = np.random.default_rng(KINDS.index(kind)), 0, 0
    while offers < 600:
        n, m = random.integers(1, 4), random.integers(2, 7)
        size = random.integers(-(-m // n), -(-m // n) + 5)
        pairs = random_pairs(random, kind, size + 8, n, m)
        random.shuffle(pairs)
        stack = filled(pairs[:size])
        if stack.rank < m:
            continue
        for candidate in pairs[size:]:
            taken += assert_offer_is_brute_force(stack, candidate)
            assert_measured(stack)
            offers += 1
    assert offers > taken > 50


@pytest.mark.parametrize('kind', KINDS)
def test_pruned_search_equals_brute_force_with_more_parameters_than_kept_directions(kind):
    random, offers, taken = np.random.default_rng(100 + KINDS.index(kind)), 0, 0
    n, m, size = 3, MOST + 6, 12
    while offers < 250:
        pairs = random_pairs(random, kind, size + 60, n, m)
        random.shuffle(pairs)
        stack = filled(pairs[:size])
        for k, candidate in enumerate(pairs[size:]):
            if stack.rank < m:
                stack.offer(candidate, candidate.sum(axis=1))
                continue
            if k % 9 == 8:  # what the stack holds already, or hardly less
                candidate = (1.0 - random.choice([0.0, 1e-9])) * stack.regressors[k % size]
            taken += assert_offer_is_brute_force(stack, candidate)
            offers += 1
        assert_measured(stack)
    assert offers > taken > 15


@pytest.mark.parametrize('candidate', [[2.0, 0.0], [0.0, -1.0], [4.0, 0.0]])
def test_a_replacement_that_leaves_sigma_min_as_it_is_is_taken(candidate):
    stack = HistoryStack(1, 2, 2, 0.0)
    for row in ([1.0, 0.0], [0.0, 1.0]):
        stack.offer(np.array([row]), np.ones(1))
    assert stack.sigma_min == 1.0
    slot = 0 if candidate[0] else 1
    assert stack.offer(np.array([candidate]), np.ones(1)) == slot  # the >= of Algorithm 1
    assert stack.sigma_min == 1.0
    np.testing.assert_array_equal(stack.regressors[slot], [candidate])


def test_equal_pairs_are_found_equal_by_the_search():
    random = np.random.default_rng(30)
    pairs = np.repeat(random.normal(size=(5, 2, 4)), 3, axis=0)  # none is missed
    stack = filled(pairs)
    for _ in range(200):
        assert_offer_is_brute_force(stack, random.normal(size=(2, 4)))
        assert_measured(stack)


def test_offering_a_stored_pair_again_does_not_lower_sigma_min():
    random = np.random.default_rng(7)
    for _ in range(100):
        stack = filled(random.normal(size=(4, 2, 4)))
        before = stack.sigma_min
        assert_offer_is_brute_force(stack, stack.regressors[random.integers(4)].copy())
        assert stack.sigma_min >= before - rounding_of(stack.regressors)


@pytest.mark.parametrize('kind', KINDS)
def test_sigma_min_never_falls_once_the_stack_is_full_and_of_full_rank(kind):
    random = np.random.default_rng(8)
    stack, last, insertions = HistoryStack(2, 5, 7, 0.1), 0.0, 0
    for candidate in random_pairs(random, kind, 1500, 2, 5):
        stack.offer(candidate, np.zeros(2))
        if stack.full and stack.rank == 5:
            assert stack.sigma_min >= last - rounding_of(stack.regressors, candidate)
            last = stack.sigma_min
            insertions = stack.insertions
    assert insertions > 20


def test_sums_stay_exact_over_hundreds_of_replacements():
    random, stack = np.random.default_rng(9), HistoryStack(2, 5, 7, 0.0)
    for k in range(4000):  # ever larger pairs are ever better
        scale = 1.005 ** k
        stack.offer(scale * random.normal(size=(2, 5)), scale * random.normal(size=2))
        if k % 100 == 0:
            assert_measured(stack)
    assert stack.insertions > 600
    assert_measured(stack)


def test_a_huge_pair_leaves_no_rounding_behind():
    random, stack = np.random.default_rng(10), HistoryStack(1, 3, 4, 0.0)
    direction = np.array([[1.0, 0.0, 0.0]])
    for scale in (1e9, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0):
        stack.offer(scale * (direction + 1e-3 * random.normal(size=(1, 3))), np.full(1, scale))
    for _ in range(20):
        stack.offer(random.normal(size=(1, 3)), random.normal(size=1))
        assert_measured(stack)
    assert stack.rank == 3
    assert np.abs(stack.regressors).max() < 10.0


def test_a_huge_pair_that_is_replaced_leaves_no_rounding_behind():
    stack = filled(np.array([[[3e6, 1e6]], [[0.3, 10.0]], [[-0.2, 9.0]]]))
    assert stack.offer(np.array([[20.0, 0.7]]), np.ones(1)) == 0
    assert stack.rank == 2
    assert_measured(stack)


@pytest.mark.parametrize('m', [3, 6])
def test_rank_never_falls_while_the_stack_is_deficient(m):
    random = np.random.default_rng(11)
    for _ in range(30):
        hidden = random.normal(size=(m - 1, m))  # everything offered lies in a subspace
        stack, last = HistoryStack(1, m, m + 1, 0.05), 0
        for k in range(150):
            weights = np.zeros(m - 1)
            weights[random.integers(0, 1 + min(k // 20, m - 2))] = 1.0
            stack.offer((weights + 0.5 * random.normal() * weights)[np.newaxis] @ hidden,
                        np.zeros(1))
            assert stack.rank >= last
            assert stack.sigma_min == 0.0
            last = stack.rank
            assert_measured(stack)
        assert last == m - 1


def test_a_full_stack_of_one_direction_makes_room_for_others():
    stack = HistoryStack(1, 3, 4, 0.0)
    for scale in (1.0, 2.0, 3.0, 4.0):
        stack.offer(np.array([[scale, 0.0, 0.0]]), np.zeros(1))
    assert (stack.full, stack.rank) == (True, 1)
    for unit in np.eye(3)[1:]:
        assert stack.offer(unit[np.newaxis], np.zeros(1)) >= 0
    assert stack.rank == 3


def test_an_indispensable_pair_is_passed_over():
    stack = HistoryStack(1, 3, 3, 0.0)
    for row in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]):
        stack.offer(np.array([row]), np.zeros(1))
    slots = [stack.offer(np.array([[0.0, y, 0.0]]), np.zeros(1)) for y in (3.0, 4.0, 5.0)]
    assert slots == [-1, 1, 2]
    assert stack.rank == 2


@hypothesis.given(seed=st.integers(0, 1_000_000), n=st.integers(1, 3), m=st.integers(2, 6),
                  epsilon=st.floats(0.0, 1.5), closeness=st.floats(1e-3, 3.0))
def test_difference_is_that_of_the_spectral_norm(seed, n, m, epsilon, closeness):
    random = np.random.default_rng(seed)
    last = random.normal(size=(n, m))
    candidate = last + closeness * random.normal(size=(n, m))
    ratio = np.linalg.norm(candidate - last, 2) / np.linalg.norm(candidate, 2)
    hypothesis.assume(abs(ratio - epsilon) > 1e-9)
    assert is_different(candidate, last, epsilon) == (ratio >= epsilon)


def test_a_zero_or_non_finite_candidate_is_not_different():
    for value in (0.0, float('nan'), float('inf')):
        stack = HistoryStack(1, 2, 2, 0.0)
        assert stack.offer(np.full((1, 2), value), np.zeros(1)) == -1
        assert stack.count == 0


def test_comparison_is_with_the_last_pair_taken_not_the_last_offered():
    stack = HistoryStack(1, 2, 10, 0.1)
    values = [1.0, 1.05, 1.09, 1.12, 1.2]  # 1.12 differs from 1.0 by more than a tenth of itself
    slots = [stack.offer(np.array([[v, 0.0]]), np.zeros(1)) for v in values]
    assert slots == [0, -1, -1, 1, -1]


def test_a_stack_of_random_motion_reaches_full_rank():
    random, stack = np.random.default_rng(12), HistoryStack(2, 5, 7, 0.1)
    ranks = []
    for _ in range(20):
        stack.offer(random.normal(size=(2, 5)), np.zeros(2))
        ranks.append(stack.rank)
    assert ranks[:3] == [2, 4, 5]
    assert stack.full


def test_pairs_are_copied():
    stack, regressor, torque = HistoryStack(1, 2, 2, 0.1), np.ones((1, 2)), np.ones(1)
    stack.offer(regressor, torque)
    regressor[:], torque[:] = 5.0, 5.0
    np.testing.assert_array_equal(stack.regressors[0], np.ones((1, 2)))
    np.testing.assert_array_equal(stack.torques[0], np.ones(1))
    assert stack.offer(np.ones((1, 2)), np.ones(1)) == -1


def test_clearing_forgets_everything():
    random = np.random.default_rng(13)
    pairs = random.normal(size=(9, 2, 3))
    used, fresh = HistoryStack(2, 3, 4, 0.1), HistoryStack(2, 3, 4, 0.1)
    for pair in pairs:
        used.offer(pair, pair.sum(axis=1))
    used.clear()
    assert (used.count, used.insertions, used.rank, used.sigma_min) == (0, 0, 0, 0.0)
    for pair in pairs:
        assert used.offer(pair, pair.sum(axis=1)) == fresh.offer(pair, pair.sum(axis=1))
    np.testing.assert_array_equal(used.gram, fresh.gram)
    np.testing.assert_array_equal(used.moment, fresh.moment)


@pytest.mark.parametrize(('size', 'epsilon', 'name'), [
    (0, 0.1, 'size'), (-1, 0.1, 'size'), (3, -0.1, 'epsilon'), (3, float('nan'), 'epsilon'),
    (3, 1.0001, 'epsilon'), (3, float('inf'), 'epsilon')])
def test_size_and_threshold_are_checked(size, epsilon, name):
    with pytest.raises(ParameterError, match=rf'identifier\.history\.{name}'):
        HistoryStack(1, 2, size, epsilon)


def test_a_full_stack_takes_only_what_raises_sigma_min_by_the_minimum_growth():
    random, stack = np.random.default_rng(15), HistoryStack(2, 5, 7, 0.0, minimum_growth=0.1)
    taken, last = 0, 0.0
    for _ in range(2000):
        candidate, full, before = random.normal(size=(2, 5)), stack.full, stack.regressors.copy()
        best = float(np.max(brute_force(before, candidate))) if full else np.inf
        slot = stack.offer(candidate, np.zeros(2))
        assert (slot >= 0) == (best >= 1.1 * last)
        assert not full or slot < 0 or stack.sigma_min >= 1.1 * last * (1.0 - 1e-9)
        taken, last = taken + (full and slot >= 0), stack.sigma_min
    assert 3 < taken < 60


@pytest.mark.parametrize('growth', [-0.1, float('nan'), float('inf')])
def test_minimum_growth_is_checked(growth):
    with pytest.raises(ParameterError, match=r'identifier\.history\.minimum_growth'):
        HistoryStack(1, 2, 3, 0.1, growth)


# -- another size and other settings while it runs -------------------------------------------


def torques_of(stack: HistoryStack) -> np.ndarray:
    """What `filled` stores with every pair."""
    return stack.regressors[:stack.count].sum(axis=2)


def without(pairs: np.ndarray, slot: int) -> np.ndarray:
    return np.delete(pairs, slot, axis=0)


def missing(before: np.ndarray, after: np.ndarray) -> int:
    """Return the slot of the pair that left."""
    left = [slot for slot, pair in enumerate(before)
            if not any(np.array_equal(pair, other) for other in after)]
    assert len(left) == len(before) - len(after) == 1
    return left[0]


def test_a_larger_stack_keeps_all_pairs_and_appends_again():
    random = np.random.default_rng(16)
    pairs = random.normal(size=(10, 2, 3))
    stack, fresh = filled(pairs[:4]), HistoryStack(2, 3, 9, 0.0)
    stack.resize(9)
    assert (stack.size, stack.count, stack.full, stack.shrinking) == (9, 4, False, False)
    assert_measured(stack)
    for pair in pairs[:4]:
        fresh.offer(pair, pair.sum(axis=1))
    for pair in pairs[4:]:
        assert stack.offer(pair, pair.sum(axis=1)) == fresh.offer(pair, pair.sum(axis=1))
        assert_measured(stack)
        np.testing.assert_array_equal(stack.torques[:stack.count], torques_of(stack))
    np.testing.assert_array_equal(stack.regressors, fresh.regressors)


@hypothesis.settings(max_examples=60, deadline=None)
@hypothesis.given(seed=st.integers(0, 1_000_000), kind=st.sampled_from(KINDS),
                  n=st.integers(1, 3), m=st.integers(2, 5), surplus=st.integers(1, 6))
def test_a_smaller_stack_loses_the_pair_that_sigma_min_misses_least(seed, kind, n, m, surplus):
    random = np.random.default_rng(seed)
    left = -(-m // n) + 1
    stack = filled(random_pairs(random, kind, left + surplus, n, m))
    hypothesis.assume(stack.rank == m)
    stack.resize(left)
    while stack.shrinking:
        before = stack.regressors[:stack.count].copy()
        best = max(sigma_of(without(before, slot)) for slot in range(len(before)))
        hypothesis.assume(best > 1e3 * rounding_of(before))  # below that it is a question of rank
        assert stack.offer(np.ones((n, m)), np.ones(n)) == -1
        assert stack.count == len(before) - 1
        assert sigma_of(stack.regressors) >= best - rounding_of(before)
        assert_measured(stack)
        np.testing.assert_array_equal(stack.torques, torques_of(stack))
    assert stack.regressors.shape == (left, n, m)


integers = st.integers(-2, 2)


@hypothesis.settings(max_examples=150, deadline=None)
@hypothesis.given(st.data(), st.integers(1, 2), st.integers(2, 4), st.integers(2, 6))
def test_a_deficient_stack_loses_the_oldest_pair_that_its_rank_misses_least(data, n, m, size):
    # Few directions, so that ranks lack and pairs stand in for each other in part.
    pairs = np.zeros((size, n, m))
    for k in range(size):
        for row in range(n):
            pairs[k, row, data.draw(st.integers(0, m - 1))] = 1.0 + k + data.draw(integers)
    hypothesis.assume(all(pair.any() for pair in pairs))
    hypothesis.assume(len({pair.tobytes() for pair in pairs}) == size)
    stack = filled(pairs)
    order = [pair.copy() for pair in stack.regressors]  # oldest first
    stack.resize(1)
    while stack.shrinking:
        before = stack.regressors[:stack.count].copy()
        ranks = [true_rank(without(np.array(order), k)) for k in range(len(order))]
        stack.offer(np.ones((n, m)), np.ones(n))
        gone = before[missing(before, stack.regressors[:stack.count])]
        place = next(k for k, pair in enumerate(order) if np.array_equal(pair, gone))
        assert ranks[place] == stack.rank == max(ranks)
        if max(ranks) < m:  # else σ_min decides
            assert place == ranks.index(max(ranks))
        del order[place]
        assert_measured(stack)


def test_a_pair_that_leaves_takes_its_rounding_along():
    pairs = np.array([[[1.0, 0.0], [0.0, 3e-6]], [[1e-6, 0.0], [0.0, 1.0]]])
    stack = filled(pairs)
    stack.resize(1)
    stack.offer(pairs[0], np.zeros(2))
    np.testing.assert_allclose(stack.gram, np.diag([1.0, 9e-12]), rtol=1e-9, atol=1e-20)
    assert stack.sigma_min == pytest.approx(9e-12, rel=1e-6)


def test_one_pair_leaves_with_every_offer_and_none_is_taken_until_then():
    random = np.random.default_rng(17)
    stack = filled(random.normal(size=(12, 2, 3)))
    stack.resize(8)
    revisions = {stack.revision}
    for count in (11, 10, 9, 8):
        assert stack.shrinking
        assert stack.offer(100.0 * random.normal(size=(2, 3)), np.zeros(2)) == -1
        assert (stack.count, stack.insertions) == (count, 12)
        assert stack.full
        revisions.add(stack.revision)
    assert len(revisions) == 5
    assert not stack.shrinking
    assert stack.offer(100.0 * random.normal(size=(2, 3)), np.zeros(2)) >= 0
    assert stack.count == 8


def test_a_stack_that_is_not_full_loses_nothing_down_to_what_it_holds():
    random = np.random.default_rng(18)
    stack = HistoryStack(2, 3, 50, 0.0)
    pairs = random.normal(size=(6, 2, 3))
    for pair in pairs:
        stack.offer(pair, pair.sum(axis=1))
    stack.resize(6)
    assert stack.full
    assert not stack.shrinking
    np.testing.assert_array_equal(stack.regressors, pairs)
    assert_offer_is_brute_force(stack, random.normal(size=(2, 3)))  # it knows its weakest pair


def test_growing_again_stops_the_loss():
    stack = filled(np.random.default_rng(19).normal(size=(12, 2, 3)))
    stack.resize(4)
    stack.offer(np.ones((2, 3)), np.ones(2))
    stack.resize(20)
    assert (stack.count, stack.full, stack.shrinking) == (11, False, False)
    assert stack.offer(np.ones((2, 3)), np.full(2, 3.0)) == 11
    assert_measured(stack)
    np.testing.assert_array_equal(torques_of(stack), stack.torques[:12])


def test_a_shrinking_stack_can_be_cleared():
    stack = filled(np.random.default_rng(20).normal(size=(12, 2, 3)))
    stack.resize(4)
    stack.offer(np.ones((2, 3)), np.ones(2))
    stack.clear()
    assert (stack.count, stack.full, stack.shrinking) == (0, False, False)
    assert stack.regressors.shape == (4, 2, 3)


@pytest.mark.parametrize('settings', [(0, 0.1, 0.0), (5, -0.1, 0.0), (5, 1.5, 0.0),
                                      (5, 0.1, float('inf'))])
def test_settings_are_changed_all_or_none(settings):
    stack = filled(np.random.default_rng(21).normal(size=(7, 2, 3)), epsilon=0.1)
    with pytest.raises(ParameterError):
        stack.retune(*settings)
    assert (stack.size, stack.epsilon, stack.minimum_growth, stack.count) == (7, 0.1, 0.0, 7)
    stack.retune(5, 0.2, 0.3)
    assert (stack.size, stack.epsilon, stack.minimum_growth) == (5, 0.2, 0.3)


def test_the_first_pair_differs_from_an_empty_history_by_one():
    for n in (1, 2, 3):
        pair = np.random.default_rng(n).normal(size=(n, 4))
        assert is_different(pair, np.zeros((n, 4)), 1.0)
        assert not is_different(pair, np.zeros((n, 4)), 1.0 + 1e-9)


@hypothesis.settings(max_examples=300, deadline=None)
@hypothesis.given(st.data(), st.integers(1, 2), st.integers(2, 5), st.integers(1, 6))
def test_the_rank_grows_whenever_some_replacement_makes_it_grow(data, n, m, size):
    row = st.lists(integers, min_size=n * m, max_size=n * m).filter(any)
    stack = filled(np.array([data.draw(row) for _ in range(size)], float).reshape(size, n, m))
    for _ in range(4):
        candidate = np.array(data.draw(row), float).reshape(n, m)
        before, rank = stack.regressors.copy(), stack.rank
        hypothesis.assume(rank < m)
        ranks = []
        for slot in range(size):
            trial = before.copy()
            trial[slot] = candidate
            ranks.append(true_rank(trial))
        stack.offer(candidate, candidate.sum(axis=1))
        assert stack.rank == max(rank, *ranks)
        assert_measured(stack)


def test_a_copied_or_resized_stack_is_offered_pairs_by_itself():
    random = np.random.default_rng(11)
    stack = filled(random.normal(size=(6, 2, 3)))
    other = copy.deepcopy(stack)
    count, gram = stack.insertions, stack.gram.copy()
    for candidate in 3.0 * random.normal(size=(4, 2, 3)):
        other.offer(candidate, candidate.sum(axis=1))
    assert other.insertions > count
    assert stack.insertions == count
    np.testing.assert_array_equal(stack.gram, gram)
    stack.resize(9)
    candidate = random.normal(size=(2, 3))
    assert stack.offer(candidate, candidate.sum(axis=1)) == 6
    np.testing.assert_array_equal(stack.regressors[6], candidate)
    assert_measured(stack)


@pytest.mark.skipif(not COMPILED, reason='numba is not installed or switched off')
def test_a_pair_from_python_takes_the_machine_code_that_compiled_functions_call():
    stack = filled(np.random.default_rng(12).normal(size=(6, 2, 3)))
    stack.resize(8)
    assert history_step.offer.part.overloads
    assert not history_step.offer.overloads  # compiled once more, which takes long
    assert not history_step.measure.overloads
