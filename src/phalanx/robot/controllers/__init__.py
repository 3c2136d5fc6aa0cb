"""Controllers, which robots run and auditors replay; python_controller.py has the base class for your own."""
