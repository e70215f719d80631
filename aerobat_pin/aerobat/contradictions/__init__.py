"""Contradictions between the channels of a log: wrong units, wrong orders, held, interpolated and late channels."""

from aerobat_pin.aerobat.contradictions.log_channels import contradictions

__all__ = ["contradictions"]
