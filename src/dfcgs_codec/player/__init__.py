"""The player: a page that shows a `.dgs` file in the browser."""
