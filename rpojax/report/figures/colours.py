"""Colours of page, figures and films (Okabe and Ito): distinguishable in print and for colour-blind readers."""

INK = "#1a2433"
MUTED = "#5b6776"
GRID = "#e3e8ee"
FAINT = "#f1f4f7"
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
VERMILLION = "#D55E00"
PURPLE = "#CC79A7"
SKY_BLUE = "#56B4E9"
YELLOW = "#F0E442"
SHADE = "#8a97a8"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"

# Lighter variants of the same hues, for lines on black.
FILM_GROUND = "#2a3340"
FILM_INK = "#f2f4f7"
FILM_MUTED = "#a9b3bf"
FILM_GREEN = "#2fd6a3"
FILM_AMBER = "#ff8a33"
FILM_BLUE = "#56B4E9"

# Of the page's dark scheme, for pictures that are drawn twice.
DARK_GROUND = "#11161d"
DARK_INK = "#e6eaf0"
DARK_MUTED = "#9aa6b5"
