"""What a posterior over sets of effects amounts to.

detection: whether anything acts; novelty: whether something unlisted does; verdict: the answer in a word; evened:
probabilities of causes that look alike; intervals: parameters; budget: shares of the gap.
"""
