// SPDX-License-Identifier: Apache-2.0
// Which sanitizer this is compiled for: g++ defines a macro for each, clang answers __has_feature.
#pragma once

#ifdef __has_feature
#if __has_feature(address_sanitizer)
#define GS_ADDRESS_SANITIZER
#endif
#if __has_feature(thread_sanitizer)
#define GS_THREAD_SANITIZER
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) && !defined(GS_ADDRESS_SANITIZER)
#define GS_ADDRESS_SANITIZER
#endif
#if defined(__SANITIZE_THREAD__) && !defined(GS_THREAD_SANITIZER)
#define GS_THREAD_SANITIZER
#endif
