"""What follows from a posterior over sets of effects.

detection: whether any effect acts; novelty: whether something unlisted acts; verdict: the answer in one word; evened:
probabilities of look-alikes made more even; intervals: intervals of parameters; budget: shares of the gap;
one_face: directions where one face is known; unusual: notes on implausibly strong effects.
"""
