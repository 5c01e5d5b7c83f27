"""Commands that find gains, uncertainties and worst cases, or compare campaigns."""
