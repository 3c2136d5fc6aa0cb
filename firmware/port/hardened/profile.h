/* What port/check.c calls in this profile, which has no authenticators of a-nodes. */
#define PROFILE "hardened"
#define MAKE_AUTH_A(a, out) ((void)(a), (void)(out), PHX_E_ARG)
#define CHECK_AUTH_A(s, thash, id, mac) ((void)(s), (void)(thash), (void)(id), (void)(mac), PHX_E_ARG)
#define SEALED_MAKE phx_sealed_make
#define SEALED_SEND phx_sealed_send
#define SEALED_RECV phx_sealed_recv
