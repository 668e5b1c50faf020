"""A diagnosis of real cloth under control: what is planted in the pictures, or known of them, must be found.

pictures: changes of a picture; planted_data: a data set seen through such a change, or with its labels dealt anew;
known_answers: every control of a fabric and its right answer; reading: what a diagnosis says, in the terms of the
rules; judgement: the rules; run: diagnoses of one fabric; figures: shares with their intervals; table: how they are
written.
"""
