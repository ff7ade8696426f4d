% Whether a pattern takes a value; a record takes every record that has more. Written for benchmarks/rv.py.
:- module(deep_subdict, [deep_subdict/2]).

deep_subdict(Pattern, Value) :-
    (   var(Pattern) -> Pattern = Value
    ;   is_dict(Pattern) -> is_dict(Value), dict_pairs(Pattern, _, Fields), fields_in(Fields, Value)
    ;   is_list(Pattern) -> is_list(Value), maplist(deep_subdict, Pattern, Value)
    ;   Pattern = Value
    ).

fields_in([], _).
fields_in([Key-Pattern|Rest], Value) :-
    get_dict(Key, Value, Found),
    deep_subdict(Pattern, Found),
    fields_in(Rest, Value).
