"""One module for each form that `gamekeeper export --to` knows; its name is the form's."""
