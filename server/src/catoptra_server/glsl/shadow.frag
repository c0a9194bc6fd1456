// Provides nothing but the depth that is written anyway.
// Twin: none, it has no colour.
void main()
{
}
