"""What a solver may spend and what it has spent: budget and meter, the journal that a killed run goes on from.

budget: `Budget`, `Meter`; journal: what is kept on disk; bookkeeping: the one way by which a drape is asked for, found
in the journal or computed, and paid.
"""
