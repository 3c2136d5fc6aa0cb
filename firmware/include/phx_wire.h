/* Made by firmware/generate.py from src/phalanx/wire/table.py. */
#ifndef PHX_WIRE_H
#define PHX_WIRE_H

#define PHX_HASH_BYTES 20u
#define PHX_MAC_BYTES 8u
#define PHX_KEY_BYTES 20u
#define PHX_NONCE_BYTES 8u
#define PHX_PACKET_MAX 2048u
#define PHX_ENTRY_HEADER_BYTES 7u
#define PHX_AUDIT_HEADER_BYTES 6u
#define PHX_ENTRY_INPUT 1u
#define PHX_ENTRY_RECV 2u
#define PHX_ENTRY_SEND 3u
#define PHX_ENTRY_ACMD 4u
#define PHX_KIND_AUDIT 128u

/* mission key, blinded with the master key */
#define PHX_MKEY 0x10u
#define PHX_MKEY_BYTES 45u
#define PHX_MKEY_K 1u
#define PHX_MKEY_R 21u
#define PHX_MKEY_SEQ 41u

/* authenticator of an s-node */
#define PHX_AUTH_S 0x11u
#define PHX_AUTH_S_BYTES 31u
#define PHX_AUTH_S_THASH 1u
#define PHX_AUTH_S_ID 21u
#define PHX_AUTH_S_NONCE 23u

/* the same in profile `paper` */
#define PHX_AUTH_S_PAPER 0x11u
#define PHX_AUTH_S_PAPER_BYTES 23u
#define PHX_AUTH_S_PAPER_THASH 1u
#define PHX_AUTH_S_PAPER_ID 21u

/* authenticator of an a-node; in profile `paper` only */
#define PHX_AUTH_A_PAPER 0x12u
#define PHX_AUTH_A_PAPER_BYTES 23u
#define PHX_AUTH_A_PAPER_THASH 1u
#define PHX_AUTH_A_PAPER_ID 21u

/* token request */
#define PHX_TREQ 0x13u
#define PHX_TREQ_BYTES 29u
#define PHX_TREQ_T 1u
#define PHX_TREQ_AUDITEE 5u
#define PHX_TREQ_AUDITOR 7u
#define PHX_TREQ_THASH_A 9u

/* the same in profile `paper` */
#define PHX_TREQ_PAPER 0x13u
#define PHX_TREQ_PAPER_BYTES 9u
#define PHX_TREQ_PAPER_T 1u
#define PHX_TREQ_PAPER_AUDITEE 5u
#define PHX_TREQ_PAPER_AUDITOR 7u

/* an auditor's proof that it replayed the log and found no fault */
#define PHX_TOKEN 0x14u
#define PHX_TOKEN_BYTES 29u
#define PHX_TOKEN_AUDITOR 1u
#define PHX_TOKEN_AUDITEE 3u
#define PHX_TOKEN_T 5u
#define PHX_TOKEN_HCKPT 9u

/* a packet on a sealed radio */
#define PHX_SEALED 0x15u
#define PHX_SEALED_BYTES 27u
#define PHX_SEALED_T 1u
#define PHX_SEALED_SRC 5u
#define PHX_SEALED_HASH 7u

/* follows each packet on a sealed radio */
#define PHX_SEAL_BYTES 14u
#define PHX_SEAL_T 0u
#define PHX_SEAL_SRC 4u
#define PHX_SEAL_MAC 6u

/* frames with the AUDIT bit */
#define PHX_AUDIT_SRC 1u
#define PHX_AUDIT_DST 3u

#endif
