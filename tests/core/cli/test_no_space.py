"""No space left, played by a limit on the size of files: clean errors, code 6, nothing half written."""

from toy_runner import RUN_A


def run_limited(toy, *words, **settings):
    """On two ranks, none of which can write a file beyond 4 MiB once the step loop is near."""
    return toy(*RUN_A, *words, ranks=2, fault__kind='"full disk"', **settings)


def test_the_third_failed_checkpoint_ends_the_run(toy):
    done = run_limited(toy, "--checkpoint-every", "10", rows=400_000, steps=60)
    assert done.returncode == 6, done.stderr
    assert done.stderr.count("WARNING hpcpic.run: checkpoint at step") == 2
    assert "Traceback" not in done.stderr
    assert list((toy.folder / "a" / "checkpoints").iterdir()) == []


def test_a_checkpoint_that_fails_at_the_end_is_exit_6(toy):
    done = run_limited(toy, rows=400_000, steps=5)
    assert done.returncode == 6, done.stderr
    assert done.stderr.count("cannot write the checkpoint") == 1


def test_output_that_fails_does_not_stop_the_physics(toy):
    done = run_limited(toy, rows=20_000, steps=60, output__field=1)
    assert done.returncode == 6, done.stderr
    assert "no field output from step" in done.stderr
    facts = toy.facts("a")
    assert facts["steps"] == 60 and toy.checkpoints("a") == [60]
    assert "output is missing" in facts["reason"]
    assert facts["state_digest"] == toy.digest(rows=20_000, steps=60)
