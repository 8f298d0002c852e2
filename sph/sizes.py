"""Numbers that the program and its forecasts both read. Without numpy."""

LEVELS = 4  # heights per spacing at which a gauge of elevation looks
