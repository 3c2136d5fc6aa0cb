/* What port/check.c calls in this profile. */
#include "phx_paper.h"

#define PROFILE "paper"
#define MAKE_AUTH_A phx_anode_make_auth
#define CHECK_AUTH_A phx_snode_check_auth_a
/* It has no sealed radio. */
#define SEALED_MAKE(a) ((void)(a), PHX_E_ARG)
#define SEALED_SEND(...) PHX_E_ARG
#define SEALED_RECV(...) PHX_E_ARG
