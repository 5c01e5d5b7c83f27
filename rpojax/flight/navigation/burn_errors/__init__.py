"""What flight software knows of the errors of burns: new ones, lasting ones, and a thruster that degrades."""
