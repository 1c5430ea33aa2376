"""A second command on a folder exits with one line, or continues what the first one has done."""

import shutil
import time

from oracle import cases, count, only_in_make_hostile, rng_of
from small_runs import RUNS, SHORT, differing, left_over, results

pytestmark = only_in_make_hostile


def test_two_writers_on_one_folder_leave_what_one_leaves(server, inputs, whole, tmp_path):
    rng, refused = rng_of("two writers"), 0
    for number in cases(0.12):
        command, out = rng.choice((*SHORT, *SHORT, "envs.evaluate", "m3depth.train")), tmp_path / str(number)
        run, seconds = RUNS[command], whole(command).seconds
        first = server.start(run.entry, run.line(out, inputs))
        time.sleep(rng.choice((0, 0.5 * rng.random() * seconds)))
        second = server.start(run.entry, run.line(out, inputs))
        ended = [server.wait(*one) for one in (first, second)]
        for one in ended:
            one.check("another command")
        assert any(one.code == 0 for one in ended), ended
        refused += any(one.code == 2 for one in ended)
        count(command, "two writers")
        assert not left_over(out) and not list(differing(whole(command).results, results(run, out)))
        shutil.rmtree(out)
    assert refused > 0
