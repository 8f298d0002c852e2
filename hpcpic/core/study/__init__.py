"""Studies: many runs of one case.

sweep      sweep.py
stability  stability.py prints and draws, bisection.py finds the limits
tradeoff   tradeoff.py prints, search.py runs levels, error_models.py fits laws to them, proposals.py proposes settings,
           recommend.py runs them and certifies; front.py, ways_out.py and record.py use what was found
of both    pilot.py runs the case with other sizes; quantities.py and field.py measure the runs
"""
