"""How sure the numbers of a case are: variations of its numerical choices, and estimates from them."""
