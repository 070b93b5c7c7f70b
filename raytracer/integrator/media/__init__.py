"""Media on the way of rays: what gets through, what shines, and what is scattered to where paths go on."""
