"""Extensions of Sphinx with which the site takes its reference from the code."""
