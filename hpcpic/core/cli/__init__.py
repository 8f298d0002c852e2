"""WHICH VERB: the commands of every simulator that are about one case or one run; main.py finds them.

run, restart            run.py, restart.py prepare a job, job.py does it
list, show              cases.py
check, estimate         check.py, cures.py, kernels.py; estimate.py
bench, doctor           bench.py, doctor.py
runs of other commands  launch.py
"""
