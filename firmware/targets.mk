# The nodes for the microcontrollers they are made for: `make targets` compiles them and says how large they are. Objects
# lie in build/TARGET/, with the stack of each function beside them (*.su).
TARGETS := cortex-m0plus cortex-m3 cortex-m33 mips32
ARM := arm-none-eabi-
MIPS := mipsel-linux-gnu-
# What robots get: one profile, small, and nothing of a C library but memcpy and memset.
FOR_TARGETS := -std=c99 -pedantic -Wall -Wextra -Wconversion -Werror -Os -ffreestanding -ffunction-sections -fdata-sections \
	-fstack-usage -fcallgraph-info=su -g0 -Iinclude -Iports/bare
NODES := $(SHARED) bound

# $(1) target, $(2) prefix of its tools, $(3) flags that choose its processor
define target
$(1)-tools := $(2)
$(1)-flags := $(3)
build/$(1)/%.o: src/%.c $(HEADERS)
	@mkdir -p build/$(1)
	@$(2)gcc $(3) $$(FOR_TARGETS) -c $$< -o $$@

.PHONY: target-$(1)
target-$(1): $(NODES:%=build/$(1)/%.o)
	@echo "$(1)"
	@$(2)size -t $$^
endef
$(eval $(call target,cortex-m0plus,$(ARM),-mcpu=cortex-m0plus -mthumb))
$(eval $(call target,cortex-m3,$(ARM),-mcpu=cortex-m3 -mthumb))
$(eval $(call target,cortex-m33,$(ARM),-mcpu=cortex-m33+nodsp+nofp -mthumb))
# Without the calling conventions of shared libraries, of which a microcontroller has none.
$(eval $(call target,mips32,$(MIPS),-march=mips32r2 -EL -msoft-float -mno-abicalls -fno-pic -G0))

.PHONY: targets
targets: $(TARGETS:%=target-%)
