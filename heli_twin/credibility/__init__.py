"""What may be believed of the twin, and why: a ledger of claims, and NASA's credibility factors, with evidence."""

from heli_twin.credibility.ledger import Claim, Factor, Ledger, Witness, read_ledger

__all__ = ["Claim", "Factor", "Ledger", "Witness", "read_ledger"]
