"""Does it really hold? Outcomes of rigid bodies and Coulomb's law, and proofs of verdicts.

The margin is a best case over forces that statics leave open. A verdict tells whether rest is the
only thing that can happen with given torques (Pang and Trinkle, 2000), with a proof, or shows a
motion that would be an outcome, too.
"""
