% The rewriting rules of RML without data that is bound between events, as docs/rml.md states them.
% Written for benchmarks/rv.py, for whoever has SWI-Prolog but not the reference monitor.
:- module(trace_expressions, [next/3, may_halt/1]).

next(1, _, 1) :- !.
next(eps, _, _) :- !, fail.
next(A \/ B, E, S) :- !, ( next(A, E, A1) -> S = A1 ; next(B, E, S) ).
next(A | B, E, S) :- !, ( next(A, E, A1) -> forked(A1, B, S) ; next(B, E, B1), forked(A, B1, S) ).
next(A * B, E, S) :- !, ( next(A, E, A1) -> followed(A1, B, S) ; may_halt(A), next(B, E, S) ).
next(A /\ B, E, S) :- !, next(A, E, A1), next(B, E, B1), joined(A1, B1, S).
next((T >> A ; B), E, S) :- !,
    (   user:match(E, T) -> next(A, E, A1), filtered(T, A1, B, S)
    ;   next(B, E, B1), filtered(T, A, B1, S)
    ).
next(star(A), E, S) :- !, next(A, E, A1), followed(A1, star(A), S).
next(plus(A), E, S) :- !, next(A, E, A1), followed(A1, star(A), S).
next(optional(A), E, S) :- !, next(A, E, S).
next(clos(A), E, S) :- !, next(A, E, A1), ( A1 == 1 -> S = 1 ; S = clos(A1) ).
next(T, E, eps) :- user:match(E, T).

may_halt(1) :- !.
may_halt(eps) :- !.
may_halt(A \/ B) :- !, ( may_halt(A) -> true ; may_halt(B) ).
may_halt(A | B) :- !, may_halt(A), may_halt(B).
may_halt(A * B) :- !, may_halt(A), may_halt(B).
may_halt(A /\ B) :- !, may_halt(A), may_halt(B).
may_halt((_ >> A ; B)) :- !, may_halt(A), may_halt(B).
may_halt(star(_)) :- !.
may_halt(optional(_)) :- !.
may_halt(clos(_)) :- !.
may_halt(plus(A)) :- may_halt(A).

followed(1, _, 1) :- !.
followed(eps, T, T) :- !.
followed(T, eps, T) :- !.
followed(A * B, C, A * (B * C)) :- !.
followed(A, B, A * B).

forked(1, T, T) :- !.
forked(T, 1, T) :- !.
forked(eps, T, T) :- !.
forked(T, eps, T) :- !.
forked(A | B, C, A | (B | C)) :- !.
forked(A, B, A | B).

joined(1, T, T) :- !.
joined(T, 1, T) :- !.
joined(A /\ B, C, A /\ (B /\ C)) :- !.
joined(A, B, A /\ B).

filtered(_, 1, 1, 1) :- !.
filtered(T, A, B, (T >> A ; B)).
