"""How many of thirty broken lines the tests notice."""
