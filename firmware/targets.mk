# The nodes for the microcontrollers they are made for: `make targets` compiles them and says how large they are. Objects
# lie in build/TARGET/, with the stack of each function beside them (*.su).
TARGETS := cortex-m0plus cortex-m3 cortex-m33 mips32
ARM := arm-none-eabi-
MIPS := mipsel-linux-gnu-
# What robots get: one profile, small, and nothing of a C library but memcpy and memset.
FOR_TARGETS := -std=c99 -pedantic -Wall -Wextra -Wconversion -Werror -Os -ffreestanding -ffunction-sections -fdata-sections \
	-fstack-usage -fcallgraph-info=su -g0 -Iinclude -Iports/bare
NODES := $(SHARED) hardened seal
LINES := $(basename $(notdir $(wildcard line/*.c)))

# $(1) target, $(2) prefix of its tools, $(3) flags that choose its processor, $(4) what the compiler calls for wide numbers
define target
$(1)-tools := $(2)
$(1)-flags := $(3)
$(1)-libgcc := $(4)
build/$(1)/%.o: src/%.c $(HEADERS)
	@mkdir -p build/$(1)
	@$(2)gcc $(3) $$(FOR_TARGETS) -c $$< -o $$@

build/$(1)/%.o: line/%.c $(HEADERS)
	@mkdir -p build/$(1)
	@$(2)gcc $(3) $$(FOR_TARGETS) -Isrc -c $$< -o $$@

.PHONY: target-$(1)
target-$(1): $(NODES:%=build/$(1)/%.o) $(LINES:%=build/$(1)/%.o)
	@echo "$(1)"
	@$(2)size -t $$^
endef
$(eval $(call target,cortex-m0plus,$(ARM),-mcpu=cortex-m0plus -mthumb,-lgcc))
$(eval $(call target,cortex-m3,$(ARM),-mcpu=cortex-m3 -mthumb,-lgcc))
$(eval $(call target,cortex-m33,$(ARM),-mcpu=cortex-m33+nodsp+nofp -mthumb,-lgcc))
# Without the calling conventions of shared libraries, of which a microcontroller has none.
$(eval $(call target,mips32,$(MIPS),-march=mips32r2 -EL -msoft-float -mno-abicalls -fno-pic -G0))

.PHONY: targets
targets: $(TARGETS:%=target-%)

# --- images: nodes, serial line and a board's port, to be run without an operating system. NAME is a robot's, and
# NAME-bench one whose clock is told (tests/test_qemu.py).
NO_SYSTEM := -Iports/bare -nostdlib -static -fno-tree-loop-distribute-patterns -Wl,--gc-sections -Wl,--build-id=none -Lports/bare
BARE := $(LINE) ports/bare/start.c ports/bare/memory.c

# $(1) image, $(2) target, $(3) linker script, $(4) what else it is made of
define image
build/$(1).elf: $(BARE) $(4) ports/bare/clock_own.c $(3) ports/bare/sections.ld $(HEADERS)
	@mkdir -p build
	@$$($(2)-tools)gcc $$($(2)-flags) $$(FOR_TARGETS) -Isrc $$($(1)-defines) $(NO_SYSTEM) $$(filter %.c,$$^) -T $(3) $$($(2)-libgcc) -o $$@

build/$(1)-bench.elf: $(BARE) $(4) ports/bare/clock_told.c $(3) ports/bare/sections.ld $(HEADERS)
	@mkdir -p build
	@$$($(2)-tools)gcc $$($(2)-flags) $$(FOR_TARGETS) -Isrc $$($(1)-defines) $(NO_SYSTEM) $$(filter %.c,$$^) -T $(3) $$($(2)-libgcc) -o $$@

IMAGES += build/$(1).elf build/$(1)-bench.elf
endef
CORTEX := ports/bare/cortex_m.c
SYSTICK := ports/bare/systick.c
NOTHING := ports/bare/ram_flash.c ports/bare/nothing_hangs.c
mps2-an385-defines := -DUART=0x40004000u -DCLOCK_HZ=25000000u
mps2-an505-defines := -DUART=0x50200000u -DCLOCK_HZ=20000000u
$(eval $(call image,mps2-an385,cortex-m3,ports/mps2/an385.ld,ports/mps2/board.c $(CORTEX) $(SYSTICK) $(NOTHING)))
$(eval $(call image,mps2-an505,cortex-m33,ports/mps2/an505.ld,ports/mps2/board.c $(CORTEX) $(SYSTICK) $(NOTHING)))
$(eval $(call image,microbit,cortex-m0plus,ports/microbit/nrf51.ld,ports/microbit/board.c $(CORTEX) $(NOTHING)))
$(eval $(call image,malta,mips32,ports/malta/malta.ld,ports/malta/board.c $(NOTHING)))

.PHONY: images
images: $(IMAGES)

# --- both worlds of TrustZone-M: the nodes in the secure one, a c-node in the other (tests/test_trustzone.py)
TRUSTZONE := $(filter-out line/serve.c,$(BARE)) ports/bare/cortex_m.c ports/bare/clock_own.c ports/bare/ram_flash.c ports/trustzone/secure.c
build/trustzone.elf: $(TRUSTZONE) ports/trustzone/secure.ld ports/bare/sections.ld ports/trustzone/gate.h $(HEADERS)
	@mkdir -p build
	@$(ARM)gcc $(cortex-m33-flags) -mcmse $(FOR_TARGETS) -Isrc $(NO_SYSTEM) $(filter %.c,$^) -T ports/trustzone/secure.ld -lgcc \
		-Wl,--cmse-implib,--out-implib=build/gates.o -o $@

build/trustzone-cnode.elf: build/trustzone.elf ports/trustzone/cnode.c ports/trustzone/cnode.ld src/mac.c ports/bare/memory.c
	@$(ARM)gcc $(cortex-m33-flags) $(FOR_TARGETS) -Isrc $(NO_SYSTEM) $(filter %.c,$^) line/frame.c build/gates.o \
		-T ports/trustzone/cnode.ld -lgcc -o $@
