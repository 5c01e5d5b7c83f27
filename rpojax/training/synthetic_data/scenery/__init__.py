"""What surrounds spacecraft in synthetic images: space, Moon, the Earth, and what lies before them."""
