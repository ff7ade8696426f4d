"""Results as pages: self-contained HTML that needs no network and runs no script but its own."""
