"""Answering withheld cases.

blind: answers that see nothing but the case; leave_out: without the case's own effect; oracle: with the true cause;
shown_shift: difference between a case and its twin without the effect.
"""
