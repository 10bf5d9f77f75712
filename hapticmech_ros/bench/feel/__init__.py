"""What reaches the hand: felt beside desired impedance, over frequency."""
