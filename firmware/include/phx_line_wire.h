/* Made by firmware/generate.py from src/phalanx/wire/lines.py. */
#ifndef PHX_LINE_WIRE_H
#define PHX_LINE_WIRE_H

#define PHX_LINE_VERSION 1u
#define PHX_LINE_MARK 0u
#define PHX_LINE_CRC_BYTES 4u
#define PHX_LINE_RUN_MAX 254u
#define PHX_LINE_TOLD_CLOCK 1u
#define PHX_LINE_TOLD_READINGS 2u
#define PHX_LINE_SEALED 4u
#define PHX_LINE_E_CALL (-64)
#define PHX_LINE_E_HELLO (-65)

/* handshake; answered with `about` */
#define PHX_CALL_HELLO 0x40u
#define PHX_CALL_HELLO_BYTES 4u
#define PHX_CALL_HELLO_NUMBER 1u
#define PHX_CALL_HELLO_VERSION 3u

/* manufacture: set the limits of both nodes and reset them; only before a master key is loaded */
#define PHX_CALL_LIMITS 0x41u
#define PHX_CALL_LIMITS_BYTES 51u
#define PHX_CALL_LIMITS_NUMBER 1u
#define PHX_CALL_LIMITS_F_MAX 3u
#define PHX_CALL_LIMITS_T_VAL_MS 7u
#define PHX_CALL_LIMITS_BATCH_SIZE 11u
#define PHX_CALL_LIMITS_BUCKET_CAPACITY 15u
#define PHX_CALL_LIMITS_BUCKET_PERIOD_MS 19u
#define PHX_CALL_LIMITS_SEND_US_PER_S 23u
#define PHX_CALL_LIMITS_SEND_CAPACITY_US 27u
#define PHX_CALL_LIMITS_AUDIT_US_PER_S 31u
#define PHX_CALL_LIMITS_AUDIT_CAPACITY_US 35u
#define PHX_CALL_LIMITS_AIRTIME_FIXED_US 39u
#define PHX_CALL_LIMITS_AIRTIME_NS_PER_BYTE_BROADCAST 43u
#define PHX_CALL_LIMITS_AIRTIME_NS_PER_BYTE_UNICAST 47u

/* to both nodes */
#define PHX_CALL_LOAD_MASTER 0x42u
#define PHX_CALL_LOAD_MASTER_BYTES 25u
#define PHX_CALL_LOAD_MASTER_NUMBER 1u
#define PHX_CALL_LOAD_MASTER_KEY 3u
#define PHX_CALL_LOAD_MASTER_ID 23u

/* to both nodes */
#define PHX_CALL_LOAD_MISSION 0x43u
#define PHX_CALL_LOAD_MISSION_BYTES 55u
#define PHX_CALL_LOAD_MISSION_NUMBER 1u
#define PHX_CALL_LOAD_MISSION_K 3u
#define PHX_CALL_LOAD_MISSION_R 23u
#define PHX_CALL_LOAD_MISSION_SEQ 43u
#define PHX_CALL_LOAD_MISSION_MAC 47u

/* set the time of a test board */
#define PHX_CALL_CLOCK 0x44u
#define PHX_CALL_CLOCK_BYTES 7u
#define PHX_CALL_CLOCK_NUMBER 1u
#define PHX_CALL_CLOCK_T 3u

/* s-node; result an `entry` */
#define PHX_CALL_POLL 0x45u
#define PHX_CALL_POLL_BYTES 3u
#define PHX_CALL_POLL_NUMBER 1u
#define PHX_CALL_POLL_READING 3u

/* a-node; result an `entry` */
#define PHX_CALL_RECV 0x46u
#define PHX_CALL_RECV_BYTES 3u
#define PHX_CALL_RECV_NUMBER 1u
#define PHX_CALL_RECV_PACKET 3u

/* a-node; result an `entry` */
#define PHX_CALL_SEND 0x47u
#define PHX_CALL_SEND_BYTES 3u
#define PHX_CALL_SEND_NUMBER 1u
#define PHX_CALL_SEND_PACKET 3u

/* a-node; result an `entry` */
#define PHX_CALL_ACTUATE 0x48u
#define PHX_CALL_ACTUATE_BYTES 3u
#define PHX_CALL_ACTUATE_NUMBER 1u
#define PHX_CALL_ACTUATE_COMMAND 3u

/* s-node; result an `authenticator` */
#define PHX_CALL_MAKE_AUTH 0x49u
#define PHX_CALL_MAKE_AUTH_BYTES 11u
#define PHX_CALL_MAKE_AUTH_NUMBER 1u
#define PHX_CALL_MAKE_AUTH_NONCE 3u

/* s-node */
#define PHX_CALL_CHECK_AUTH 0x4au
#define PHX_CALL_CHECK_AUTH_BYTES 41u
#define PHX_CALL_CHECK_AUTH_NUMBER 1u
#define PHX_CALL_CHECK_AUTH_TOP 3u
#define PHX_CALL_CHECK_AUTH_ID 23u
#define PHX_CALL_CHECK_AUTH_NONCE 25u
#define PHX_CALL_CHECK_AUTH_MAC 33u

/* a-node; result a `token_request` */
#define PHX_CALL_TOKEN_REQUEST 0x4bu
#define PHX_CALL_TOKEN_REQUEST_BYTES 5u
#define PHX_CALL_TOKEN_REQUEST_NUMBER 1u
#define PHX_CALL_TOKEN_REQUEST_AUDITOR 3u

/* a-node; result the token's MAC */
#define PHX_CALL_ISSUE_TOKEN 0x4cu
#define PHX_CALL_ISSUE_TOKEN_BYTES 57u
#define PHX_CALL_ISSUE_TOKEN_NUMBER 1u
#define PHX_CALL_ISSUE_TOKEN_AUDITEE 3u
#define PHX_CALL_ISSUE_TOKEN_T 5u
#define PHX_CALL_ISSUE_TOKEN_TOP 9u
#define PHX_CALL_ISSUE_TOKEN_TREQ_MAC 29u
#define PHX_CALL_ISSUE_TOKEN_HCKPT 37u

/* a-node */
#define PHX_CALL_CHECK_TOKEN 0x4du
#define PHX_CALL_CHECK_TOKEN_BYTES 39u
#define PHX_CALL_CHECK_TOKEN_NUMBER 1u
#define PHX_CALL_CHECK_TOKEN_AUDITOR 3u
#define PHX_CALL_CHECK_TOKEN_AUDITEE 5u
#define PHX_CALL_CHECK_TOKEN_T 7u
#define PHX_CALL_CHECK_TOKEN_HCKPT 11u
#define PHX_CALL_CHECK_TOKEN_MAC 31u

/* a-node */
#define PHX_CALL_INSTALL_TOKEN 0x4eu
#define PHX_CALL_INSTALL_TOKEN_BYTES 37u
#define PHX_CALL_INSTALL_TOKEN_NUMBER 1u
#define PHX_CALL_INSTALL_TOKEN_AUDITOR 3u
#define PHX_CALL_INSTALL_TOKEN_T 5u
#define PHX_CALL_INSTALL_TOKEN_HCKPT 9u
#define PHX_CALL_INSTALL_TOKEN_MAC 29u

/* a-node; returns code 1 in Safe Mode */
#define PHX_CALL_CHECK 0x4fu
#define PHX_CALL_CHECK_BYTES 3u
#define PHX_CALL_CHECK_NUMBER 1u

/* manufacture: seal the radio permanently; only before a master key is loaded */
#define PHX_CALL_SEAL 0x50u
#define PHX_CALL_SEAL_BYTES 3u
#define PHX_CALL_SEAL_NUMBER 1u

/* answer to a call */
#define PHX_ANSWER 0x60u
#define PHX_ANSWER_BYTES 7u
#define PHX_ANSWER_NUMBER 1u
#define PHX_ANSWER_CODE 3u
#define PHX_ANSWER_RESULT 7u

/* description of a board */
#define PHX_ABOUT_BYTES 8u
#define PHX_ABOUT_VERSION 0u
#define PHX_ABOUT_TOLD 1u
#define PHX_ABOUT_ID 2u
#define PHX_ABOUT_SEQ 4u

#endif
