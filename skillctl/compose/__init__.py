"""Skills made from skills: merge, combine, and the common Lyapunov matrix that proves a merger."""
