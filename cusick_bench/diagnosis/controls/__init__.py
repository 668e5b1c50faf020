"""Controls of the diagnosis on real cloth: what is planted in the pictures, or known about them, must be found.

pictures: changes of a picture; planted_data: a data set with changed pictures or permuted labels; known_answers: every
control of a fabric and its right answer; reading: what a diagnosis says, as the rules need it; judgement: the rules;
run: diagnoses of one fabric; figures: shares with their intervals; table: files that are written.
"""
