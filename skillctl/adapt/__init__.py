"""What a task wants: weights, candidates, common proofs and refits. A floor above the rooms it uses."""
