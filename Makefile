# `make demo` and `make test` are all a newcomer needs; both set up what is missing first and are quick the second time.
CARGO ?= cargo
export PATH := $(HOME)/.cargo/bin:$(PATH)

.PHONY: demo test build setup bench clean

build:
	@scripts/setup.sh build
	$(CARGO) build --release --locked

demo: build
	target/release/sweetspot demo

test:
	@scripts/setup.sh test
	scripts/check.sh

bench: build
	$(CARGO) bench

clean:
	$(CARGO) clean
	rm -rf demo-results .venv
