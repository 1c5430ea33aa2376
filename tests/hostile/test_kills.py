"""A run that is killed again and again continues to the results of an undisturbed run, and leaves nothing over."""

import shutil

import pytest
from kills import DEATHS, KILLS
from oracle import IN_PROCESSES, cases, count, only_in_make_hostile, rng_of
from small_runs import KILLED, RUNS, differing, left_over, results

pytestmark = only_in_make_hostile
IN_A_ROW = 5  # most kills of a run before it may end


@pytest.mark.parametrize("command", KILLED)
def test_a_killed_run_continues_to_the_same_results(command, server, inputs, whole, tmp_path):
    run, rng = RUNS[command], rng_of(command)
    undisturbed, kills = whole(command), 0
    for number in cases(0.2):
        out, history = tmp_path / str(number), []
        for _ in range(min(rng.randint(2, IN_A_ROW), IN_PROCESSES - kills)):
            kind = rng.choice(list(KILLS))

            def start(out=out, **more):
                return server.start(run.entry, run.line(out, inputs), out=str(out), **more)

            ended = KILLS[kind](rng, undisturbed, start, server)
            assert ended.code in (0, *DEATHS), f"{history}: {ended.stderr}"
            history.append(f"{kind}: {ended.code}")
            if ended.code == 0:
                break
            kills += 1
            count(command, kind)
        ended = server.run(run.entry, run.line(out, inputs))
        assert ended.code == 0, f"{history}: {ended.stderr}"
        assert not left_over(out), history
        assert not list(differing(undisturbed.results, results(run, out))), history
        shutil.rmtree(out)
        if kills >= IN_PROCESSES:
            break
    assert kills > 0
